"""Marks of a figure from events and settings: alarms, errors, and the limits in force."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jbclog.analysis.figures.curves import Span
from jbclog.analysis.figures.trace import Limit, Mark, MarkKind
from jbclog.analysis.verdict.rules import COUNTED_ALARMS, SEVERE

ERRORS = ("station.error", "port.error", "robot.off")
SIDES = ("high", "low")
NAMES = [f"alarm_{side}_{what}" for side in SIDES for what in ("limit", "delay")]
Place = tuple[str, int | None]
"""Station and port."""
ENDS = {"station.error": "station.ok", "port.error": "port.ok", "robot.off": "robot.on"}


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
    """Return all events on the time axis, corrected for steps of the wall clock."""
    stepped, out = 0.0, []
    for event in events.to_dict("records"):
        if event["kind"] == "clock.step" and not pd.isna(event["value"]):
            stepped += float(event["value"])
        end = _seconds(event["time"], t0_utc_us) - stepped
        start = (
            end
            if pd.isna(event["earliest"])
            else min(end, _seconds(event["earliest"], t0_utc_us) - stepped)
        )
        place = (
            _text(event["station"]),
            _whole(event["port"]),
            _whole(event["code"]),
            _text(event["raw"]),
        )
        out.append(Happening(start, end, str(event["kind"]), str(event["severity"]), *place))
    return out


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
    errors = [
        _error(one, own[i + 1 :])
        for i, one in enumerate(own)
        if one.kind in ERRORS and one.code != 0
    ]
    return [*alarms, *doubtful, *errors]


def is_alarm(one: Happening) -> bool:
    """Return whether the event is an alarm that counts, as in the verdict."""
    return one.kind in COUNTED_ALARMS and one.severity in SEVERE


def _error(one: Happening, later: Sequence[Happening]) -> Mark:
    """Return the error from its earliest time to the reading that ended or changed it, else to its
    own time.
    """
    following = (one.kind, ENDS[one.kind])
    end = next(
        (other.end for other in later if other.kind in following and other.port == one.port),
        one.end,
    )
    word = (
        one.kind.replace(".", " ")
        if one.code is None
        else f"{one.kind.replace('.', ' ')} {one.code}"
    )
    return Mark(Span(one.start, end, word), MarkKind.ERROR)


def limits_of(settings: pd.DataFrame, t0_utc_us: int) -> dict[Place, list[Limit]]:
    """Return the confirmed limits of each port, each from its reading on; none while the alarm is
    off.
    """
    rows = settings[settings["setting"].isin(NAMES) & settings["readback"].notna()]
    found: dict[Place, dict[str, list[tuple[float, str]]]] = {}
    columns = (rows[name] for name in ("station", "port", "setting", "time", "readback"))
    for station, port, name, time, text in zip(*columns, strict=True):
        own = found.setdefault((str(station), _whole(port)), {})
        own.setdefault(str(name), []).append((_seconds(time, t0_utc_us), str(text)))
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
    try:
        return float(text)
    except ValueError:  # "off"
        return float("nan")


def _seconds(time: pd.Timestamp, t0_utc_us: int) -> float:
    return (round(time.timestamp() * 1e6) - t0_utc_us) / 1e6


def _text(value: object) -> str | None:
    return None if pd.isna(value) else str(value)  # type: ignore[call-overload]  # one cell


def _whole(value: object) -> int | None:
    return None if pd.isna(value) else int(value)  # type: ignore[call-overload]  # one cell
