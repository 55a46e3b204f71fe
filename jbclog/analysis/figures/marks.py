"""Marks of a figure from events and settings: alarms, errors, and the limits in force."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbclog.analysis.alarms.state_machine import number_of
from jbclog.analysis.figures.curves import Span
from jbclog.analysis.figures.trace import Limit, Mark, MarkKind
from jbclog.analysis.verdict.rules import COUNTED_ALARMS, SEVERE

ERRORS = ("station.error", "port.error", "robot.off")
SIDES = ("high", "low")
NAMES = [f"alarm_{side}_{what}" for side in SIDES for what in ("limit", "delay")]
Place = tuple[str, int | None]
"""Station and port."""
OF_END = {"station.ok": "station.error", "port.ok": "port.error", "robot.on": "robot.off"}
"""The error that an event ends."""


@dataclass(frozen=True, slots=True)
class Happening:
    """An event on the run's time axis, in s; `start` is its earliest possible time."""

    start: float
    end: float
    kind: str
    severity: str
    station: str | None
    port: int | None
    code: int | None
    raw: str | None


def happenings(events: pd.DataFrame, t0_utc_us: int) -> list[Happening]:
    """Return all events on the time axis, corrected for steps that their times follow."""
    is_step = events["kind"].eq("clock.step").fillna(False) & events["raw"].isna()
    stepped = events["value"].where(is_step).fillna(0.0).cumsum().to_numpy(np.float64)
    ends = _seconds_of(events["time"], t0_utc_us) - stepped
    starts = np.fmin(ends, _seconds_of(events["earliest"], t0_utc_us) - stepped)
    others = (
        events[name].astype(object).where(events[name].notna(), None)
        for name in ("kind", "severity", "station", "port", "code", "raw")
    )
    return [Happening(*one) for one in zip(starts.tolist(), ends.tolist(), *others, strict=True)]


def marks_of(all_of_run: Iterable[Happening], station: str, port: int) -> list[Mark]:
    """Return the alarms (earliest to latest time) and errors (until they ended) of a port and its
    station.
    """
    own = [one for one in all_of_run if one.station == station and one.port in (None, port)]
    alarms = [
        Mark(Span(one.start, one.end, one.kind.removeprefix("alarm.")), MarkKind.ALARM)
        for one in own
        if is_alarm(one)
    ]
    doubtful = [
        Mark(Span(one.start, one.end, one.raw or ""), MarkKind.UNCONFIRMED)
        for one in own
        if one.kind == "alarm.unconfirmed"
    ]
    return [*alarms, *doubtful, *_errors(own)]


def is_alarm(one: Happening) -> bool:
    """Return whether the event is an alarm that counts, as in the verdict."""
    return one.kind in COUNTED_ALARMS and one.severity in SEVERE


def _errors(own: Sequence[Happening]) -> list[Mark]:
    """Return each error from its earliest time to the reading that ended or changed it, else to its
    own time.
    """
    found: list[Mark] = []
    next_end: dict[tuple[str, int | None], float] = {}  # of an error's kind: of what follows it
    for one in reversed(own):
        kind = OF_END.get(one.kind, one.kind)
        if one.kind in ERRORS and one.code != 0:
            end = next_end.get((kind, one.port), one.end)
            word = one.kind.replace(".", " ") + ("" if one.code is None else f" {one.code}")
            found.append(Mark(Span(one.start, end, word), MarkKind.ERROR))
        next_end[kind, one.port] = one.end
    return found[::-1]


def limits_of(settings: pd.DataFrame, t0_utc_us: int) -> dict[Place, list[Limit]]:
    """Return the confirmed limits of each port, each from its reading on; none while the alarm is
    off.
    """
    rows = settings[settings["setting"].isin(NAMES) & settings["readback"].notna()]
    found: dict[Place, dict[str, list[tuple[float, str]]]] = {}
    columns = (rows[name] for name in ("station", "port", "setting", "readback"))
    seconds = _seconds_of(rows["time"], t0_utc_us).tolist()
    for station, port, name, text, at_s in zip(*columns, seconds, strict=True):
        own = found.setdefault((str(station), _whole(port)), {})
        own.setdefault(str(name), []).append((at_s, str(text)))
    return {place: [*_limits(own)] for place, own in found.items()}


def _limits(own: Mapping[str, Sequence[tuple[float, str]]]) -> Iterator[Limit]:
    """Yield the limits of one port from the readings of its settings: when, and what."""
    for side in SIDES:
        delays, read = (own.get(f"alarm_{side}_{what}") or [] for what in ("delay", "limit"))
        celsius = tuple(_celsius(text) for _, text in read)
        is_off = bool(delays) and delays[-1][1] == "off"
        if not is_off and not np.isnan(celsius).all():
            yield Limit(side, tuple(seconds for seconds, _ in read), celsius)


def _celsius(text: str) -> float:
    found = number_of(text)
    return float("nan") if found is None else found


def _seconds_of(times: pd.Series, t0_utc_us: int) -> NDArray[np.float64]:
    """Return times in s of the run; NaN for a missing one."""
    micros = times.dt.as_unit("us").astype("int64").to_numpy()
    return np.where(times.isna(), np.nan, (micros - t0_utc_us) / 1e6)


def _whole(value: object) -> int | None:
    return None if pd.isna(value) else int(value)  # type: ignore[call-overload]  # one cell
