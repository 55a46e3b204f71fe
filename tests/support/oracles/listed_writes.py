"""What may stand on the wire behind a W, by the manuals' letters and the recipe's text: none of the
program's tables.

``strange_writes`` gives what a run sent although neither its recipe nor a safe state asked for it.
The codes are those of manuals 002 (soldering, feeder), 001 (hot air) and 003 (OMEGA's D); a value
is compared as it stands on the wire.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import cast

from support.virtual.virtual_run import Heard

Table = Mapping[str, object]
OFF = "99999"
PORT = re.compile(r"W(?:[HL][AD]|S[TFE]|WM|PS|[ASDH](?=\d\d))(\d)")


def whole(value: object) -> str:
    number = int(cast(int, value))
    return f"{number:05d}" if number >= 0 else f"-{-number:04d}"


def seconds(value: object) -> str:
    return f"{float(cast(float, value)):05.2f}"


def times(factor: int) -> Callable[[object], str]:
    return lambda value: f"{round(float(cast(float, value)) * factor):05d}"


def word(*words: str) -> Callable[[object], str]:
    return lambda value: f"{words.index(str(value)):05d}"


SOLDERING = {
    r"D(\d)\d": ("sleep.delay_min", whole),
    r"H(\d)\d": ("hibernation.delay_min", whole),
    r"S(\d)\d": ("sleep.temperature_c", whole),
    r"A(\d)\d": ("temperature.adjust_c", whole),
    r"HA(\d)": ("alarm.high.limit_c", whole),
    r"HD(\d)": ("alarm.high.delay_s", seconds),
    r"LA(\d)": ("alarm.low.limit_c", whole),
    r"LD(\d)": ("alarm.low.delay_s", seconds),
    r"ST(\d)": ("temperature.select_c", whole),
}
FEEDER = {
    r"WCD()": ("feeder.clog_detection", word("False", "True")),
    r"DIA()": ("feeder.diameter_mm", times(100)),
    r"LEN()": ("feeder.length_mm", times(10)),
    r"BCK()": ("feeder.backward_mm", times(10)),
    r"SPD()": ("feeder.speed_mm_s", times(10)),
    r"MOD()": ("feeder.mode", word("continuous", "discontinuous", "program", "reload")),
}
AIR = {
    r"A(\d)\d": ("temperature.adjust_c", whole),
    r"WM(\d)": ("air.mode", word("manual", "profile")),
    r"SE(\d)": ("air.external_set_c", whole),
    r"ST(\d)": ("air.temperature_c", whole),
}
SETTINGS = {"ale": {**SOLDERING, **FEEDER}, "jtse": AIR, "omega": {}}
STATES = {
    "jtse": {"on": "00001", "off": "00000", "cooling": "00010"},
    "omega": {},
}
STATES_002 = {"working": "00000", "stand": "00001", "extractor": "00010"}
SAFE = {"jtse": ("cooling", "off"), "omega": ()}
OMEGA_FIELDS = (
    *(
        "rise_s",
        "feed1_mm",
        "feed1_mm_s",
        "reverse1_mm",
        "reverse1_mm_s",
        "preheat_s",
        "feed2_mm",
        "feed2_mm_s",
    ),
    *(
        "reverse2_mm",
        "reverse2_mm_s",
        "heating_s",
        "feed3_mm",
        "feed3_mm_s",
        "reverse3_mm",
        "reverse3_mm_s",
    ),
)


def strange_writes(
    heard: Sequence[Heard],
    family: str,
    recipe: str,
    ports: Collection[int] | None = None,
    *,
    omega_may_write: bool = False,
) -> list[str]:
    """What of this station's questions writes something that the recipe does not ask for and no
    safe state is.

    `ports`: those that the line names, None for all.
    """
    table = tomllib.loads(recipe)
    if family == "omega":
        allowed = {_condition(table)} if omega_may_write else set()
        return [one.text for one in heard if one.text[:1] in "DHI" and one.text not in allowed]
    fastest = {one.sent[4:] for one in heard if one.text == "RMAF" and one.sent}
    writes = [one.text for one in heard if one.is_write]
    return [
        text
        for text in writes
        if not (_is_at(text, ports) and any(_allows(text, family, table, fastest)))
    ]


def _is_at(text: str, ports: Collection[int] | None) -> bool:
    port = PORT.match(text)
    return port is None or ports is None or int(port[1]) in ports


def _allows(text: str, family: str, recipe: Table, fastest: Iterable[str]) -> Iterator[bool]:
    """One True is enough."""
    yield family == "ale" and text in ("WSTP00000", "WSTP")
    for pattern, (path, as_sent) in SETTINGS.get(family, SOLDERING).items():
        found = re.fullmatch(rf"W{pattern}([-.\d]{{5}})", text)
        value = None if found is None else asked(recipe, path, found[1])
        yield (
            found is not None
            and value is not None
            and found[2] == (OFF if value == "off" else as_sent(value))
        )
    flow = re.fullmatch(r"WSF1(\d{5})", text)
    if flow and family == "jtse":
        share = asked(recipe, "air.flow_permille", "1")
        yield share is not None and int(flow[1]) in {
            round(int(cast(int, share)) * int(most) / 1000) for most in fastest
        }
    status = re.fullmatch(r"WPS\d(\d{5})", text)
    names = (
        *SAFE.get(family, ("stand", str(asked(recipe, "run.safe_state", "")))),
        str(asked(recipe, "run.status", "")),
    )
    yield status is not None and status[1] in {
        STATES.get(family, STATES_002).get(name) for name in names
    }


def asked(recipe: Table, path: str, port: str) -> object:
    """What the recipe asks for there, the port's own table first; None for nothing."""
    own = _at(recipe, f"port.{port}.{path}") if port else None
    return _at(recipe, path) if own is None else own


def _at(recipe: Table, path: str) -> object:
    found: object = recipe
    for key in path.split("."):
        found = found.get(key) if isinstance(found, dict) else None
    return found


def _condition(recipe: Table) -> str:
    """OMEGA's D with its record (docs/reference/protocol.md): the number, the mode, fifteen fields
    in tenths, all hexadecimal.
    """
    told = cast(Mapping[str, float], recipe["omega"])
    tenths = "".join(f"{round(told[name] * 10):03X}" for name in OMEGA_FIELDS)
    return f"D{int(told['condition']):04X}{int(told['mode'])}{tenths}"
