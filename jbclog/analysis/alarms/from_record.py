"""The episodes of the three detectors, from a record.

A, the station's flags (events `alarm.high`, `alarm.low`, `alarm.unconfirmed` and ``.ended``): they
begin and end between two readings of the flags. After a lost answer (`alarm.unknown`) the state is
unknown until the next reading. Flags from before the run, and of tools that do not count, make no
episode. B, our samples: beyond the limit for the on-delay, until back by the deadband for the
off-delay, as the recorder detects it. C, our samples: every excursion beyond the limit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.alarms.port_watch import Change, PortWatch
from jbclog.analysis.alarms.state_machine import (
    RETURNED,
    Detector,
    Episode,
    Rules,
    Side,
    Transition,
)
from jbclog.core.rows import EventRow

Counts = NDArray[np.int64]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LOOK_ROWS: Final = 256  # rows examined at once; doubled after as many quiet ones
SINGLE_ROWS: Final = 64  # rows taken one by one after a row that may change something

SAMPLED = (Detector.SAMPLES, Detector.AFTERWARDS)
UNKNOWN = "alarm.unknown"
UNCONFIRMED = "alarm.unconfirmed"
_RAISED = {"alarm.high": Side.HIGH, "alarm.low": Side.LOW}
_ENDED = {"alarm.high.ended": Side.HIGH, "alarm.low.ended": Side.LOW}


class Rows(NamedTuple):
    """The samples of one port as columns.

    `read`: temperature and status were read. `works`: the tool works. `setpoint_c` is NaN if not
    read. `steps_us`: row -> size of the clock step just before it.
    """

    time_us: Counts
    tick: Counts
    temperature_c: NDArray[np.number[Any]]
    read: Flags
    works: Flags
    setpoint_c: Floats
    steps_us: dict[int, int]


class FlagRead(NamedTuple):
    """The alarm flags in one row."""

    time_us: int
    high: bool
    low: bool

    def of(self, side: Side) -> bool:
        return self.high if side is Side.HIGH else self.low


class SampledEpisodes:
    """The episodes of one port by its samples; `found` has them in the order in which they were
    raised.

    `changes` of settings and tools are ordered by time, corrected for the clock steps before them.
    `rules` None: the defaults.
    """

    def __init__(
        self,
        station: str,
        port: int,
        period_s: float | None,
        changes: Iterable[Change],
        rules: Rules | None = None,
        detectors: Sequence[Detector] = SAMPLED,
    ) -> None:
        self._watch = PortWatch(station, port, period_s, rules or Rules(), detectors)
        for change in changes:
            self._watch.change(change)
        self.found: list[Episode] = []

    def feed(self, rows: Rows) -> None:
        """Take the next rows, oldest first; skip blocks of rows that change nothing."""
        place, count, look = 0, len(rows.time_us), LOOK_ROWS
        while place < count:
            quiet = self._watch.quiet_range()
            if quiet is not None:
                until = min(place + look, count)
                first = self._skip_quiet(rows, slice(place, until), quiet)
                look, place = 2 * look if first == until else LOOK_ROWS, first
            if place < count and (quiet is None or place < until):
                until = min(place + SINGLE_ROWS, count)
                self._take(rows, slice(place, until))
                place = until

    def _skip_quiet(self, rows: Rows, some: slice, quiet: tuple[float, float]) -> int:
        """Skip the rows before the first that may change something, and return its index."""
        values, read, (low, high) = rows.temperature_c[some], rows.read[some], quiet
        eventful = read & rows.works[some] & ((values < low) | (values > high))
        eventful |= rows.time_us[some] > self._watch.due_us
        places = [place - some.start for place in rows.steps_us if some.start <= place < some.stop]
        eventful[places] = True
        count = int(np.argmax(eventful)) if eventful.any() else len(eventful)
        known, setpoint_c = np.flatnonzero(read[:count]), rows.setpoint_c[some][:count]
        setpoint_c = setpoint_c[~np.isnan(setpoint_c)]
        last = None
        if len(known):
            place = some.start + int(known[-1])
            last = (
                int(rows.time_us[place]),
                int(rows.tick[place]),
                rows.temperature_c[place].item(),
            )
        self._watch.pass_by(last, float(setpoint_c[-1]) if len(setpoint_c) else None)
        return int(some.start) + count

    def _take(self, rows: Rows, some: slice) -> None:
        take, steps, found = self._watch.row, rows.steps_us, self.found
        columns = zip(
            range(some.start, some.stop),
            *(column[some].tolist() for column in rows[:-1]),
            strict=True,
        )
        for place, time_us, tick, value, is_read, works, setpoint_c in columns:
            if steps and place in steps:
                self._watch.step(steps[place])
            reports = take(
                time_us,
                tick,
                value if is_read else None,
                works,
                setpoint_c if setpoint_c == setpoint_c else None,  # NaN
            )
            if reports:
                found += [
                    episode for transition, episode in reports if transition is Transition.RAISED
                ]


def flag_episodes(events: Iterable[EventRow], reads: Sequence[FlagRead] = ()) -> list[Episode]:
    """Return the episodes of one port by its station's flags, from its alarm events.

    `reads` are readings of the flags that show whether an episode ended while an answer was lost.
    """
    found: list[Episode] = []
    active: dict[Side, Episode] = {}
    for event in events:
        if event.kind == UNKNOWN:
            for episode in active.values():
                _lose(episode, event)
        elif event.kind in _ENDED:
            ended = active.pop(_ENDED[event.kind], None)
            if ended is not None:
                ended.end(earliest_us(event), event.time, event.time, RETURNED)
        elif event.kind in _RAISED or event.kind == UNCONFIRMED:
            _raise(event, active, found, reads)
    for episode in active.values():
        _end_if_read_off(episode, reads)
    return found


def _lose(episode: Episode, event: EventRow) -> None:
    """Mark an episode as uncertain after a lost answer; until its end is known, `cleared_us` is the
    last reading before.
    """
    if not episode.is_lost:
        episode.is_lost = episode.is_uncertain = True
        episode.cleared_us = earliest_us(event)
    episode.unread_us += event.time - earliest_us(event)


def _raise(
    event: EventRow, active: dict[Side, Episode], found: list[Episode], reads: Sequence[FlagRead]
) -> None:
    side = _RAISED.get(event.kind) or (Side.LOW if event.raw == Side.LOW else Side.HIGH)
    episode = active.get(side)
    if episode is not None and episode.is_lost:
        _end_if_read_off(episode, [read for read in reads if read.time_us < event.time])
        episode.is_lost = False
        episode = episode if episode.end_us is None else None
    if episode is None:
        episode = _new(event, side)
        active[side] = episode
        found.append(episode)
    episode.is_confirmed |= event.kind in _RAISED
    if event.value is not None:
        episode.see(event.value)


def _new(event: EventRow, side: Side) -> Episode:
    assert event.station is not None
    assert event.port is not None
    return Episode(
        event.station,
        event.port,
        side,
        Detector.STATION,
        earliest_us(event),
        event.time,
        event.limit_value,
        raised_us=event.time,
        is_confirmed=False,
    )


def _end_if_read_off(episode: Episode, reads: Iterable[FlagRead]) -> None:
    """End an uncertain episode at the first reading after the lost answer with the flag off."""
    since_us = episode.cleared_us
    if not episode.is_lost or since_us is None:
        return
    episode.cleared_us = None
    for read in reads:
        if read.time_us > since_us and not read.of(episode.side):
            episode.end(since_us, read.time_us, read.time_us, RETURNED)
            return


def earliest_us(event: EventRow) -> int:
    """Return the earliest time of an event, UTC microseconds."""
    return event.time if event.earliest is None else event.earliest
