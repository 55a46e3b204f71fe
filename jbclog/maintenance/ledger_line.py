"""What a line of the ledger looks like: an observation or a fact, as JSON that people can read too.

Counts stand as ``"counts": {"1": {"work_h": 412, ...}}``; what was moving or not read stands beside it, by port and name. Units are
in the names (docs/reference/tables.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from functools import cache, lru_cache
from typing import Final, cast

from jbclog.core.durable_files import line_of, sha256
from jbclog.core.foreign.json_reader import Misfit, build, json_of
from jbclog.maintenance.counter_totals.observed import Count, Entry, Errors, Fact, Identity, Observation, Standing

Plain = dict[str, object]
OWN: Final = b', "sha256": "'
TEXTS: Final = ("time", "audit", "line", "station", "url", "why", "source", "prev_sha256")


@cache
def unit_of(counter: str) -> str:
    """By its name: ``h``, ``mm`` or ``count``."""
    return {"h": "h", "mm": "mm"}.get(counter.rpartition("_")[2], "count")


# -- writing ----------------------------------------------------------------------------------------------------------------


def written(entry: Entry) -> bytes:
    """The line of an entry, with its own hash, without its end."""
    return line_of(_observation(entry) if isinstance(entry, Observation) else asdict(entry))


def _observation(seen: Observation) -> Plain:
    plain: Plain = {one.name: getattr(seen, one.name) for one in fields(seen) if one.name != "counts"}
    plain |= {"identity": asdict(seen.identity) if seen.identity else None, "errors": asdict(seen.errors)}
    return plain | _counts(seen.counts)


def _counts(counts: tuple[Count, ...]) -> Plain:
    tables: dict[str, dict[str, dict[str, object]]] = {"counts": {}, "moving": {}, "unread": {}}
    for one in counts:
        name, said = _said(one)
        tables[name].setdefault(str(one.port), {})[one.counter] = said
    return {name: table for name, table in tables.items() if table or name == "counts"}


def _said(one: Count) -> tuple[str, object]:
    if one.standing is Standing.OK:
        return "counts", one.value
    return ("moving", list(one.values)) if one.standing is Standing.MOVING else ("unread", one.why)


# -- reading ----------------------------------------------------------------------------------------------------------------


def read_line(line: bytes) -> Entry | None:
    """What a line says; None where it is not, to the byte, what was written."""
    body, own, rest = line.rpartition(OWN)
    if not own or rest != sha256(body + b"}").encode() + b'"}':
        return None
    try:
        plain = json_of(body + b"}")
        return cast(Fact, build(Fact, plain)) if plain["kind"] == "fact" else _seen(plain)
    except (ValueError, TypeError, AttributeError, KeyError, RecursionError, Misfit):
        return None


def _seen(plain: Plain) -> Observation:
    if plain["kind"] != "observation" or not isinstance(plain["seen"], bool) or not isinstance(plain["seq"], int):
        raise Misfit("kind, seen or seq")
    return Observation(
        **{name: _text(plain[name]) for name in TEXTS},
        seen=plain["seen"],
        seq=plain["seq"],
        identity=None if plain["identity"] is None else _identity(plain["identity"]),
        errors=_errors(plain["errors"]),
        counts=tuple(_all_counts(plain)),
        tools={int(port): tool for port, tool in _texts(plain["tools"]).items()},
        parameters=_texts(plain["parameters"]),
    )


_same = lru_cache(maxsize=1024)(Identity)


def _identity(said: object) -> Identity:
    """Of a long ledger most are like one before."""
    plain = _table(said)
    texts = [plain.get(name) for name in ("family", "model", "software", "uid")]
    if texts[0] is None or not all(one is None or isinstance(one, str) for one in texts):
        raise Misfit("an identity")
    return _same(*cast("list[str]", texts))


def _errors(said: object) -> Errors:
    plain = _table(said)
    station, events, until = plain.get("station"), plain.get("events"), plain.get("until")
    if events is not None and not all(type(count) is int for count in _table(events).values()):
        raise Misfit("numbers of events")
    ports = {int(port): text for port, text in _texts(plain.get("ports", {})).items()}
    texts = [None if one is None else _text(one) for one in (station, until)]
    return Errors(texts[0], ports, cast("dict[str, int] | None", events), texts[1])


def _table(said: object) -> Plain:
    if not isinstance(said, dict):
        raise Misfit("a table")
    return said


def _texts(table: object) -> dict[str, str]:
    if not isinstance(table, dict) or not all(type(text) is str for text in table.values()):
        raise Misfit("a table of texts")
    return table


def _text(said: object) -> str:
    if not isinstance(said, str):
        raise Misfit("a text")
    return said


def _all_counts(plain: Plain) -> list[Count]:
    found = []
    for port, counters in cast("dict[str, dict[str, object]]", plain.get("counts", {})).items():
        number = int(port)
        found += [Count(number, name, unit_of(name), _number(said)) for name, said in counters.items()]
    for port, name, said in _each(plain, "moving"):
        values = tuple(_number(one) for one in cast("list[object]", said))
        found.append(Count(int(port), name, unit_of(name), None, Standing.MOVING, values))
    for port, name, said in _each(plain, "unread"):
        found.append(Count(int(port), name, unit_of(name), None, Standing.UNREAD, why=_text(said)))
    return found


def _each(plain: Plain, table: str) -> list[tuple[str, str, object]]:
    ports = cast(Mapping[str, Mapping[str, object]], plain.get(table, {}))
    return [(port, name, said) for port, counters in ports.items() for name, said in counters.items()]


def _number(said: object) -> float:
    if type(said) is float:  # most are
        return said
    if isinstance(said, bool) or not isinstance(said, int | float):
        raise Misfit("a number")
    return float(said)
