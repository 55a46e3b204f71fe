"""Series of samples for alarm episodes: made by hand or at random, as rows of a record, and a slow
second way to judge them.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

import numpy as np

from jbclog.analysis.alarms.from_record import Rows, SampledEpisodes
from jbclog.analysis.alarms.live import LiveAlarms
from jbclog.analysis.alarms.port_watch import BEFORE_ALL, WORKING, Change
from jbclog.analysis.alarms.state_machine import Detector, Episode
from jbclog.app.run.run_record import _Tap
from jbclog.core.rows import (
    COLUMN,
    SAMPLE_COLUMNS,
    EventRow,
    SampleRow,
    SettingRow,
    Severity,
    StationFacts,
)
from jbclog.record.conclude import conclude
from jbclog.record.manifest import read_manifest, write_manifest
from jbclog.record.run_journal import RunJournal
from jbclog.record.seal import seal_journal
from support.records import small_run

T0_US = 1_790_000_000_000_000
STATION = "dde-1"
PERIOD_S = 0.1
USUAL = {"dead_band_c": 2.0, "stale_s": 60.0}
CLOCK = "clock"
SETTINGS = {
    "selected_temperature": "350",
    "alarm_high_limit": "380",
    "alarm_high_delay": "0.50",
    "alarm_low_limit": "300",
    "alarm_low_delay": "1.00",
}

Reading = tuple[int, int, float | None, str | None, float | None]
"""Time, tick, temperature, status, setting."""


@dataclass
class Series:
    """One port's rows and what was found changed meanwhile."""

    period_s: float | None = PERIOD_S
    rules: dict[str, float] = field(default_factory=dict)
    rows: list[Reading] = field(default_factory=list)
    # with the number of rows before it
    changes: list[tuple[int, Change]] = field(default_factory=list)
    tick: int = 0
    stepped_us: int = 0

    def add(
        self,
        temperature: float | None,
        status: str | None = "working",
        times: int = 1,
        setpoint_c: float | None = None,
    ) -> Series:
        """Rows that are all alike."""
        for _ in range(times):
            self.rows.append((self.now_us, self.tick, temperature, status, setpoint_c))
            self.tick += 1
        return self

    def walk(self, *values: float | None) -> Series:
        for value in values:
            self.add(value)
        return self

    def skip(self, ticks: int) -> Series:
        """Ticks that have no rows: the host stood still."""
        self.tick += ticks
        return self

    def change(self, name: str, text: str | None = None) -> Series:
        self.changes.append((len(self.rows), Change(self.now_us - 1, name, text)))
        return self

    def step_clock(self, seconds: float) -> Series:
        """The wall clock is stepped; only a record (`recorded`) knows of it."""
        self.stepped_us += round(seconds * 1e6)
        return self.change(CLOCK, str(seconds))

    @property
    def now_us(self) -> int:
        return T0_US + round(self.tick * (self.period_s or PERIOD_S) * 1e6) + self.stepped_us

    @property
    def facts(self) -> StationFacts:
        return StationFacts(
            STATION,
            "dde-1.pty",
            "dde",
            ports=[1],
            period_s=self.period_s,
            alarm_rules=USUAL | self.rules,
        )


def setting_rows() -> list[SettingRow]:
    rest = (None, None)
    return [
        SettingRow(T0_US - 1_000_000, STATION, 1, None, name, "", *rest, text, None, "read")
        for name, text in SETTINGS.items()
    ]


def replayed(
    series: Series,
    detectors: Sequence[Detector] = (Detector.SAMPLES, Detector.AFTERWARDS),
    pieces: int = 1,
    steps_us: Mapping[int, int] = MappingProxyType({}),
) -> list[Episode]:
    """The episodes of the series as a record gives them, in some pieces; `steps_us`: row -> step of
    the clock before it.
    """
    from jbclog.analysis.alarms.live import rules_of

    before = [Change(BEFORE_ALL, row.setting, row.readback) for row in setting_rows()]
    changes = [*before, *(change for _, change in series.changes)]
    sampled = SampledEpisodes(
        STATION, 1, series.period_s, changes, rules_of(series.facts), detectors
    )
    size = len(series.rows) // pieces + 1
    for start in range(0, len(series.rows), size):
        steps = {row - start: step for row, step in steps_us.items() if start <= row < start + size}
        sampled.feed(rows_of(series.rows[start : start + size])._replace(steps_us=steps))
    return sampled.found


def rows_of(readings: Sequence[Reading]) -> Rows:
    times, ticks, temperatures, statuses, setpoint_c = zip(*readings, strict=True)
    return Rows(
        np.array(times),
        np.array(ticks),
        np.array([0 if one is None else one for one in temperatures]),
        np.array([row[2] is not None and row[3] is not None for row in readings]),
        np.array([status in WORKING for status in statuses]),
        np.array([np.nan if one is None else one for one in setpoint_c]),
        {},
    )


def lived(series: Series) -> list[EventRow]:
    """What a recorder tells of the series while it runs."""
    told: list[EventRow] = []
    _hand_over(series, LiveAlarms(told.append))
    return told


class Taker(Protocol):
    """Who sees what goes into a record."""

    def sample(self, row: SampleRow) -> None: ...

    def event(self, event: EventRow) -> None: ...

    def setting(self, row: SettingRow) -> None: ...

    def facts(self, facts: StationFacts) -> None: ...


def _hand_over(series: Series, taker: Taker) -> None:
    taker.facts(series.facts)
    for row in setting_rows():
        taker.setting(row)
    waiting = list(series.changes)
    for number, reading in enumerate(series.rows):
        while waiting and waiting[0][0] <= number:
            taker.event(_event(waiting.pop(0)[1]))
        taker.sample(sample_row(*reading))


@contextmanager
def being_recorded(series: Series, out: Path) -> Iterator[tuple[Path, RunJournal]]:
    """A run of the series that was taken into its live store and is still open."""
    folder, _ = small_run.begin(out, 1.0)
    store = RunJournal(folder)
    store.start()
    try:
        _hand_over(series, _Tap(store, None))
        store.commit_now()
        yield folder, store
    finally:
        store.close()
        store.release()


def recorded(series: Series, out: Path) -> Path:
    """The folder of a run of the series, sealed."""
    with being_recorded(series, out) as (folder, store):
        store.close()
        manifest = read_manifest(folder)
        manifest.stations, manifest.exit_status, manifest.exit_code = (
            [replace(series.facts, outcome="completed")],
            "success",
            0,
        )
        manifest.stop = manifest.start
        write_manifest(folder, manifest)
        seal_journal(folder)
        conclude(folder, manifest, store.lock)
    return folder


def _event(change: Change) -> EventRow:
    if change.name == CLOCK:
        return EventRow(
            change.at_us, "clock.step", Severity.WARNING, "", value=float(change.text or 0)
        )
    if change.name == "tool":
        return EventRow(change.at_us, "tool.changed", Severity.WARNING, "", STATION, 1)
    return EventRow(
        change.at_us,
        "setting.changed",
        Severity.ERROR,
        "",
        STATION,
        1,
        raw=f"{change.name}={change.text}",
    )


def sample_row(
    time_us: int, tick: int, temperature: float | None, status: str | None, setpoint_c: float | None
) -> SampleRow:
    row: SampleRow = [None] * len(SAMPLE_COLUMNS)
    cells = {
        "time": time_us,
        "tick": tick,
        "station": STATION,
        "port": 1,
        "temperature_c": temperature,
        "status": status,
    }
    for name, cell in {**cells, "setpoint_c": setpoint_c, "quality": "ok"}.items():
        row[COLUMN[name]] = cell
    return row


def random_series(seed: int, rows: int = 600) -> Series:
    """A tip that wanders over its limits, with losses, outages, stops, changes of tool and limits,
    and a host that stands still.
    """
    rng = random.Random(seed)
    rules = rng.choice(
        [{}, {"dead_band_c": 0.0}, {"dead_band_c": 5.0, "off_delay_s": 0.3}, {"stale_s": 2.0}]
    )
    series = Series(period_s=rng.choice([0.1, 0.1, 1.0, None]), rules=rules)
    temperature, lost, status = 345.0, 0, "working"
    while len(series.rows) < rows:
        temperature += (
            rng.gauss(0, 4)
            + 0.01 * (350 - temperature)
            + (rng.choice([-60, 60]) if rng.random() < 0.02 else 0)
        )
        lost = rng.randrange(1, 40) if rng.random() < 0.02 else max(lost - 1, 0)
        if rng.random() < 0.01:
            status = "stand" if status == "working" else "working"
        _disturb(series, rng)
        unread = lost > 0 or rng.random() < 0.02
        setpoint_c = rng.choice([345, 350, 355]) if rng.random() < 0.02 else None
        series.add(
            None if unread else round(temperature),
            None if unread and rng.random() < 0.5 else status,
            setpoint_c=setpoint_c,
        )
    return series


def _disturb(series: Series, rng: random.Random) -> None:
    if rng.random() < 0.005:
        series.skip(rng.randrange(1, 60))
    if rng.random() < 0.004:
        series.change("tool")
    if rng.random() < 0.01:
        name = rng.choice([*SETTINGS][1:])
        texts = {
            "limit": ["370 °C", "380 °C", "310 °C", "off"],
            "delay": ["0.00 s", "0.50 s", "2.00 s", "off"],
        }
        series.change(name, rng.choice(texts[name.rpartition("_")[2]]))


# -- the slow second way ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Plain:
    """An episode as the slow way has it: side, onset interval, raised, end interval, peak."""

    side: str
    onset: tuple[int, int]
    raised: int
    end: tuple[int, int] | None
    peak: float


def plain(episode: Episode) -> Plain:
    end = (
        None
        if episode.end_us is None or episode.end_earliest_us is None
        else (episode.end_earliest_us, episode.end_us)
    )
    assert episode.raised_us is not None
    assert episode.peak_c is not None
    return Plain(
        str(episode.side),
        (episode.onset_earliest_us, episode.onset_us),
        episode.raised_us,
        end,
        episode.peak_c,
    )


def by_the_book(
    series: Series, side: str, limit: float, delay_s: float, off_delay_s: float, band_c: float
) -> list[Plain]:
    """The definition read literally, for a series without changes: sets of readings first, then
    what they mean.

    A stretch of readings beyond the limit raises where its observed time comes to the delay; from
    there on the first stretch of readings that are back for as long ends it, or the first reading
    that does not count.
    """
    assert series.period_s is not None
    sign = 1 if side == "high" else -1
    read = [row for row in series.rows if row[2] is not None and row[3] is not None]
    counted = _counted(read)
    gap = 2 * series.period_s + 1e-6

    def dt(place: int) -> float:
        seconds = (read[place][1] - read[place - 1][1]) * series.period_s  # type: ignore[operator]
        return seconds if seconds <= gap else 0.0

    def excess(place: int) -> float:
        return sign * (float(read[place][2] or 0) - limit)

    def holds(start: int, beyond: bool, needed_s: float) -> int | None:
        """The place at which the stretch from `start` on has lasted long enough."""
        total = 0.0
        for place in range(start, len(read)):
            good = counted[place] and (excess(place) > 0 if beyond else excess(place) <= -band_c)
            if not good:
                return None
            total += dt(place) if place > start else 0.0
            if total >= needed_s - 1e-6:
                return place
        return None

    def starts(place: int, beyond: bool) -> bool:
        def good(at: int) -> bool:
            return counted[at] and (excess(at) > 0 if beyond else excess(at) <= -band_c)

        return good(place) and (place == 0 or not good(place - 1))

    def before(place: int) -> int:
        return read[max(place - 1, 0)][0]

    found, place = [], 0
    while place < len(read):
        raised = holds(place, True, delay_s) if starts(place, True) else None
        if raised is None:
            place += 1
            continue
        end, over, after = None, len(read), raised
        for later in range(raised + 1, len(read)):
            if not counted[later]:
                end, over = (before(later), read[later][0]), later
                back = (
                    next((p for p in range(later - 1, raised, -1) if excess(p) > -band_c), raised)
                    + 1
                )
                if back < later:
                    end = before(back), read[back][0]
                break
            done = (
                holds(later, False, off_delay_s)
                if excess(later) <= -band_c and excess(later - 1) > -band_c
                else None
            )
            if done is not None:
                end, over = (before(later), read[later][0]), done
                break
        peak = (
            max(
                sign * float(read[p][2] or 0)
                for p in range(place, min(over, len(read)))
                if excess(p) > 0
            )
            * sign
        )
        found.append(Plain(side, (before(place), read[place][0]), read[raised][0], end, peak))
        place = max(over, after + 1)
    return found


def _counted(read: Sequence[Reading]) -> list[bool]:
    """Whether each reading counts: at work, and once within ±10 °C of 350 °C or across it (no
    runaway in these series).
    """
    found, has_come, before = [], False, None
    for _, _, value, status, _ in read:
        assert value is not None
        if status == "working" and (
            abs(value - 350) <= 10 or (before is not None and (before < 350) != (value < 350))
        ):
            has_come = True
        found.append(has_come and status == "working")
        before = value
    return found
