"""The fixed list of what a run may write on a station: what its recipe asks for, by the manuals' letters, and its safe states.

Made from the recipe's text with a table written by hand, never from the product's: so that nothing is on the list because
somebody put it into the code (faults.md, I7 and section 9).
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping

Table = Mapping[str, object]
Encode = Callable[[object], str]


def _whole(value: object) -> str:
    return "99999" if value == "off" else f"{value:05d}"


def _scaled(factor: int) -> Encode:
    return lambda value: f"{round(float(str(value)) * factor):05d}"


def _seconds(value: object) -> str:
    return "99999" if value == "off" else f"{float(str(value)):05.2f}"


def _named(*names: str) -> Encode:
    return lambda value: f"{names.index(str(value)):05d}"


def _any_share(_value: object) -> str:
    return r"\d{5}"  # of what the station tells as its greatest


PORT, TOOL = r"[1-4]", r"[1-4][1-9]"
SETTINGS: dict[str, tuple[str, str, Encode]] = {
    "temperature.select_c": ("ST", PORT, _whole),
    "temperature.adjust_c": ("A", TOOL, _whole),
    "sleep.temperature_c": ("S", TOOL, _whole),
    "sleep.delay_min": ("D", TOOL, _whole),
    "hibernation.delay_min": ("H", TOOL, _whole),
    "alarm.high.limit_c": ("HA", PORT, _whole),
    "alarm.high.delay_s": ("HD", PORT, _seconds),
    "alarm.low.limit_c": ("LA", PORT, _whole),
    "alarm.low.delay_s": ("LD", PORT, _seconds),
    "feeder.mode": ("MOD", "", _named("continuous", "discontinuous", "program", "reload")),
    "feeder.length_mm": ("LEN", "", _scaled(10)),
    "feeder.speed_mm_s": ("SPD", "", _scaled(10)),
    "feeder.diameter_mm": ("DIA", "", _scaled(100)),
    "feeder.backward_mm": ("BCK", "", _scaled(10)),
    "feeder.clog_detection": ("WCD", "", lambda value: f"{bool(value):05d}"),
    "air.temperature_c": ("ST", PORT, _whole),
    "air.flow_permille": ("SF", PORT, _any_share),
    "air.external_set_c": ("SE", PORT, _whole),
    "air.mode": ("WM", PORT, _named("manual", "profile")),
}
"""Recipe key -> letters, what stands behind them, and the data field (seeds 001 and 002)."""

STATES = {"working": "00000", "stand": "00001", "extractor": "00010", "on": "00001", "off": "00000", "cooling": "00010"}
SAFE = {"jtse": ("cooling", "off"), "omega": ()}
ON_EVERY_PORT = re.compile(r"port\.[1-4]\.")


def may_be_written(recipe: str, family: str) -> re.Pattern[str]:
    """Every text of a write that a run of this recipe may send to a station of this family."""
    told = tomllib.loads(recipe)
    run = told.get("run", {})
    states = {run["status"]} if isinstance(run, dict) and "status" in run else set()
    words = sorted({STATES[str(one)] for one in (*states, *SAFE.get(family, ("stand", "extractor")))})
    texts = [rf"WPS{PORT}({'|'.join(words)})", *_texts(told)]
    if family == "ale":
        texts.append(r"WSTP(00000)?")
    if "omega" in told:
        texts.append(r"D.*")
    return re.compile("|".join(texts))


def _texts(told: Table) -> Iterable[str]:
    for key, value in _flat(told, ""):
        number = ON_EVERY_PORT.match(key)
        letters, place, encode = SETTINGS.get(ON_EVERY_PORT.sub("", key), ("", "", _any_share))
        if letters:
            yield f"W{letters}{place if number is None else place.replace(PORT, key[5], 1)}{encode(value)}"


def _flat(table: Table, above: str) -> Iterable[tuple[str, object]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value
