"""The ledger of counter audits: a chained file, and what its lines look like.

It may hold several lines' stations; they are told apart by line and name. A line that was changed or cut off is told with its
number and counts for nothing; what comes behind it still counts, and is still added: an audit's values are not lost because
somebody harmed the file. Whoever reads it has `wrong`, and ends with exit code 4 (`is_sound`).
"""

from __future__ import annotations

import errno
import gc
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Final, cast

from jbclog.core.durable_files import LineChain, add_lines, chain_in, line_of, sha256, sync_folder
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.foreign.json_reader import Misfit, build, json_of
from jbclog.core.locks import try_lock
from jbclog.maintenance.counter_totals.observed import Count, Entry, Errors, Fact, Identity, Observation, Standing

# -- gc pause -----------------------------------------------------------------------------------------------------------------
# Python's search for circles of garbage, put off while a long ledger is read and judged.
#
# It goes through all that there is again and again while millions of small values are made, which is half of the time; and there is
# nothing in it to be found. What is not used any more is freed at once as ever.


@contextmanager
def uncollected() -> Iterator[None]:
    """Without it, where it is on. Of the whole program: other threads are without it meanwhile, too."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


# -- ledger line --------------------------------------------------------------------------------------------------------------
# What a line of the ledger looks like: an observation or a fact, as JSON that people can read too.
#
# Counts stand as ``"counts": {"1": {"work_h": 412, ...}}``; what was moving or not read stands beside it, by port and name. Units
# are in the names (docs/reference/tables.md).

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


# -- ledger -------------------------------------------------------------------------------------------------------------------

FIRST: Final = sha256(b"jbclog counters")  # not the file's name: whoever moves or renames a ledger keeps it
LOCK: Final = ".lock"


class AuditGoesOn(UsageError):
    """Another audit writes to this ledger now. Nothing was sent."""


@dataclass(frozen=True, slots=True)
class Book:
    """Every line that can be read, oldest first; what is wrong (line, sentence); the hash of the last line."""

    path: Path
    entries: list[Entry] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)
    head: str = FIRST

    @property
    def observations(self) -> list[Observation]:
        return [one for one in self.entries if isinstance(one, Observation)]

    @property
    def facts(self) -> list[Fact]:
        return [one for one in self.entries if isinstance(one, Fact)]

    @property
    def is_sound(self) -> bool:
        """Whether the chain holds. A last line that a crash cut off was never acknowledged, and harms nothing."""
        return all("cut off" in text for _, text in self.wrong)

    @property
    def is_foreign(self) -> bool:
        """Whether the file is something else: it has lines, and not one of them is a ledger's."""
        return not self.entries and not self.is_sound

    def expect_ledger(self) -> None:
        """Raise `RecordError` where it is something else, such as a line file: nothing is put behind that."""
        if self.is_foreign:
            raise RecordError(f"{self.path} is no ledger: no line of it is one. Nothing was put behind it; name another file")

    @property
    def sentences(self) -> tuple[str, ...]:
        return tuple(f"{self.path}: line {number} {text}" for number, text in self.wrong)


def read_book(path: Path) -> Book:
    """The ledger at `path`; an empty one where there is no file. Raises `RecordError`."""
    try:
        data = read_foreign(path, Kind.LEDGER, links=True)
    except FileNotFoundError:
        return Book(path)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {_why(error)}") from error
    with uncollected():
        found: LineChain[Entry] = chain_in(data, FIRST, read_line, what="line of a ledger", of_first="a ledger's beginning")
    return Book(path, found.said, found.wrong, found.head)


def add(path: Path, entries: Iterable[Entry]) -> list[Entry]:
    """Put them at the end of the ledger, made with its folder where it is not there; give them as they stand there.

    All of them or, where the disk is full, the first of them. Raises `RecordError`.
    """
    kept: list[Entry] = []

    def made(entry: Entry, seq: int, previous: str) -> bytes:
        kept.append(replace(entry, seq=seq, prev_sha256=previous))
        return written(kept[-1])

    try:
        if not path.parent.is_dir():
            path.parent.mkdir(parents=True)
            sync_folder(path.parent.absolute().parent)
        add_lines(path, FIRST, read_line, entries, made)
    except OSError as error:
        raise RecordError(f"{path} cannot be written: {_why(error)}") from error
    return kept


def _why(error: OSError) -> str:
    return "it is a link; name the file itself" if error.errno == errno.ELOOP else error.strerror or str(error)


@contextmanager
def auditing(path: Path) -> Iterator[None]:
    """The ledger for one audit at a time. Raises `AuditGoesOn` where another has it, `RecordError` where none can be had."""
    lock = path.with_name(path.name + LOCK)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        held = try_lock(lock)
    except OSError as error:
        raise RecordError(f"{lock} cannot be made: {error.strerror or error}") from error
    if held is None:
        raise AuditGoesOn(f"another audit with the ledger {path} goes on; nothing was asked. Try again when it is through")
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(held)
