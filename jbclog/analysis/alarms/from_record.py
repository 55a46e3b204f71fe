"""The episodes of all three detectors, from a record. Those of B are the ones that the recorder reported.

A, by the station's flags (`alarm.high`, `alarm.low`, `alarm.unconfirmed` and ``.ended``): it was raised between two readings
of the flags and ended between two. After an answer that was lost (`alarm.unknown`) nobody knows whether it still stands; the
next reading says so. Flags of before the run, and of tools that do not count, are none.
B, by samples: beyond the limit for the delay; back by the dead band for as long.
C, by samples: every reading beyond the limit, as long as it lasts.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from jbclog.analysis.alarms.port_watch import Change, PortWatch
from jbclog.analysis.alarms.state_machine import RETURNED, Detector, Episode, News, Rules, Side
from jbclog.core.rows import EventRow

Numbers = Sequence[float | None]

SAMPLED = (Detector.SAMPLES, Detector.AFTERWARDS)
UNKNOWN = "alarm.unknown"
UNCONFIRMED = "alarm.unconfirmed"
_RAISED = {"alarm.high": Side.HIGH, "alarm.low": Side.LOW}
_ENDED = {"alarm.high.ended": Side.HIGH, "alarm.low.ended": Side.LOW}


class Rows(NamedTuple):
    """The samples of one port, column by column, in their order; None: not read. `steps_us`: of the clock, before each row."""

    time_us: Sequence[int]
    tick: Sequence[int]
    temperature_c: Numbers
    status: Sequence[str | None]
    set_c: Numbers
    steps_us: dict[int, int]


class FlagRead(NamedTuple):
    """The flags as they stand in one row."""

    time_us: int
    high: bool
    low: bool

    def of(self, side: Side) -> bool:
        return self.high if side is Side.HIGH else self.low


class SampledEpisodes:
    """The episodes of one port by its samples; `found` has them in the order in which they were raised.

    `changes` of settings and tools in their order, their times less the steps of the wall clock before them. `rules` None:
    those that hold where nothing else is said.
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
        """Take the next rows."""
        take, steps, found = self._watch.row, rows.steps_us, self.found
        columns = zip(rows.time_us, rows.tick, rows.temperature_c, rows.status, rows.set_c, strict=True)
        for place, (time_us, tick, temperature, status, set_c) in enumerate(columns):
            if steps and place in steps:
                self._watch.step(steps[place])
            news = take(time_us, tick, temperature, status, set_c)
            if news:
                found += [episode for what, episode in news if what is News.RAISED]


def flag_episodes(events: Iterable[EventRow], reads: Sequence[FlagRead] = ()) -> list[Episode]:
    """The episodes of one port by its station's flags: from its alarm events, and `reads` of the flags for after a loss."""
    found: list[Episode] = []
    standing: dict[Side, Episode] = {}
    for event in events:
        if event.kind == UNKNOWN:
            for episode in standing.values():
                _lose(episode, event)
        elif event.kind in _ENDED:
            ended = standing.pop(_ENDED[event.kind], None)
            if ended is not None:
                ended.end(_earliest(event), event.time, event.time, RETURNED)
        elif event.kind in _RAISED or event.kind == UNCONFIRMED:
            _raise(event, standing, found, reads)
    for episode in standing.values():
        _end_if_read_off(episode, reads)
    return found


def _lose(episode: Episode, event: EventRow) -> None:
    """The answer was lost: it was read last before it, and may have ended since."""
    if not episode.is_lost:
        episode.is_lost = episode.is_uncertain = True
        episode.cleared_us = _earliest(event)  # where it is looked on from, until it is known


def _raise(event: EventRow, standing: dict[Side, Episode], found: list[Episode], reads: Sequence[FlagRead]) -> None:
    side = _RAISED.get(event.kind) or (Side.LOW if event.raw == Side.LOW else Side.HIGH)
    episode = standing.get(side)
    if episode is not None and episode.is_lost:
        _end_if_read_off(episode, [read for read in reads if read.time_us < event.time])
        episode.is_lost = False
        episode = episode if episode.end_us is None else None
    if episode is None:
        episode = _begun(event, side)
        standing[side] = episode
        found.append(episode)
    episode.is_confirmed |= event.kind in _RAISED
    if event.value is not None:
        episode.see(event.value)


def _begun(event: EventRow, side: Side) -> Episode:
    assert event.station is not None
    assert event.port is not None
    return Episode(
        event.station,
        event.port,
        side,
        Detector.STATION,
        _earliest(event),
        event.time,
        event.limit,
        raised_us=event.time,
        is_confirmed=False,
    )


def _end_if_read_off(episode: Episode, reads: Iterable[FlagRead]) -> None:
    """Behind a lost answer: it ended before the first reading that does not show it, where there is one."""
    since = episode.cleared_us
    if not episode.is_lost or since is None:
        return
    episode.cleared_us = None
    for read in reads:
        if read.time_us > since and not read.of(episode.side):
            episode.end(since, read.time_us, read.time_us, RETURNED)
            return


def _earliest(event: EventRow) -> int:
    return event.time if event.earliest is None else event.earliest
