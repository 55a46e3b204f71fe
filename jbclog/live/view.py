"""Builds the state of a run from what its follower has read; has the rules for what counts as known
and as normal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.core.rows import PortKey, StationFacts
from jbclog.core.states import StationOutcome
from jbclog.core.text import count_text
from jbclog.live.event_history import EventHistory, SettingHistory
from jbclog.live.recorder_clock import RecorderClock
from jbclog.live.sample_history import MAIN, Last, Moment, PortHistory, SampleHistory
from jbclog.live.states import (
    NOT_READ,
    RUN_ENDED,
    Condition,
    Coverage,
    Joints,
    Phase,
    PortState,
    Reading,
    RunState,
    StationState,
)
from jbclog.record.conclude import hot_warning
from jbclog.record.manifest import Manifest

STALE_PERIODS: Final = 2.0
COMMIT_S: Final = 2.0  # longest time from a reading until a follower can see it
NO_GRID_S: Final = 3.0  # longest interval between two rows of a station without a grid
# a row this far in the future was written before the clock was set back
CLOCK_S: Final = 2.0
FLAG: Final = "alarm_high"
SETTING: Final = "setpoint_c"
DISCONNECTED: Final = "disconnected"  # in the reasons of rows
NOT_SUPPORTED: Final = Reading(why="not supported", is_stale=False)


@dataclass(frozen=True, slots=True)
class RunView:
    """Input of a state; `stations` with the facts of the journal."""

    folder: Path
    manifest: Manifest | None
    clock: RecorderClock
    stations: list[StationFacts]
    samples: SampleHistory
    events: EventHistory
    settings: SettingHistory
    joints: Mapping[PortKey, Joints]
    not_counted: Joints
    damage: list[str]
    dropped_rows: int
    is_whole: bool

    def state(self, phase: Phase, text: str) -> RunState:
        manifest = self.manifest or Manifest(self.folder.name)
        metadata = manifest.metadata
        units = self._units(metadata.units)
        return RunState(
            folder=self.folder,
            phase=phase,
            text=text,
            commit_age_s=None if phase is Phase.FINALIZED else self.clock.age_s,
            line=None if manifest.line is None else manifest.line.name,
            operator=metadata.operator,
            order=metadata.order,
            product=metadata.product,
            unit=units[0] if len(units) == 1 else None,
            units=units,
            start=manifest.start,
            stop=manifest.stop,
            verdict=manifest.verdict,
            exit_status=manifest.exit_status,
            stations=tuple(self._station(facts, phase) for facts in self.stations),
            problems=tuple(self._problems(phase)),
            events=tuple(self.events.newest),
            is_whole=self.is_whole,
        )

    def _units(self, named: Sequence[str]) -> tuple[str, ...]:
        """Return the unit on the bench, or those named at the run's start."""
        if self.events.has_units:
            return () if self.events.unit is None else (self.events.unit,)
        return tuple(named)

    def _problems(self, phase: Phase) -> list[str]:
        found = [*self.events.problems((None, None))]
        if phase in (Phase.CRASHED, Phase.FINALIZED):
            warning = hot_warning(
                self.folder, self.stations, [facts.name for facts in self.stations if facts.unsafe]
            )
            found += [warning] if warning else []
        if self.dropped_rows:
            found.append(f"{count_text(self.dropped_rows, 'row')} could not be stored.")
        return found + [f"Damaged: {one}" for one in self.damage]

    def _station(self, facts: StationFacts, phase: Phase) -> StationState:
        ports = sorted(
            {*facts.ports, *(port for name, port in self.samples.ports if name == facts.name)}
        )
        ages = self._ages(facts)
        return StationState(
            name=facts.name,
            family=facts.family,
            model=facts.model,
            outcome=str(facts.outcome),
            reason=facts.reason,
            rate_hz=facts.rate_hz,
            recipe=facts.recipe,
            problems=self.events.problems((facts.name, None)),
            ports=tuple(self._port(facts, port, phase, ages) for port in ports),
            settings=self.settings.settings(facts.name),
            counters=self.settings.counters(facts.name),
        )

    def _port(self, facts: StationFacts, number: int, phase: Phase, ages: _Ages) -> PortState:
        place = facts.name, number
        history = self.samples.ports.get(place) or PortHistory()
        is_lost = phase is Phase.RECORDING and self.events.is_link_lost(facts.name)
        is_live = phase is Phase.RECORDING and facts.outcome == StationOutcome.RUNNING
        is_live = is_live and not is_lost and not ages.is_behind(history.newest, ages.newest)
        is_old = not is_live or ages.is_old(history.newest)
        why_old = RUN_ENDED if phase is Phase.FINALIZED else DISCONNECTED if is_lost else None
        readings = {
            column: ages.reading(history, column, why_old, is_old=is_old)
            for column in {*history.values, *history.failures}
        }
        if facts.signals and MAIN not in facts.signals:
            readings.setdefault(MAIN, NOT_SUPPORTED)
        alarms = (*self.events.alarms((facts.name, None)), *self.events.alarms(place))
        problems = (
            *self.events.problems((facts.name, None)),
            *self.events.problems(place),
            *self._flags(place, history),
        )
        row_age = None if history.newest is None else ages.age_s(history.newest.moment)
        is_fresh = is_live and row_age is not None and row_age <= ages.limit_s
        if is_fresh and SETTING in facts.signals and readings.get(MAIN, NOT_READ).is_known:
            problems += _unknown_setting(readings.get(SETTING, NOT_READ))
        quality = None if history.newest is None else str(history.newest.value)
        main = readings.get(MAIN, NOT_READ)
        return PortState(
            station=facts.name,
            port=number,
            tool_name=facts.tool_names.get(number),
            condition=_condition(
                facts,
                phase,
                main,
                quality,
                is_fresh=is_fresh,
                has_alarms=bool(alarms),
                has_problems=bool(problems),
            ),
            quality=quality,
            row_age_s=row_age,
            readings=readings,
            alarms=alarms,
            problems=problems,
            coverage=Coverage(history.obtained + history.missing, history.obtained, self.is_whole),
            trace=history.points.trace(),
            hour=history.means.trace(),
            joints=self.joints.get(place, self.not_counted),
            alarms_so_far=self.events.alarms_so_far(place),
        )

    def _flags(self, place: PortKey, history: PortHistory) -> tuple[str, ...]:
        """Report a lost answer with the alarm flags until the flags are read again."""
        lost, read = self.events.flags_lost_at(place), history.values.get(FLAG)
        is_lost = lost is not None and (read is None or read.moment.time <= lost)
        return (
            ("The last answer with the alarm flags was lost; they may have been set.",)
            if is_lost
            else ()
        )

    def _ages(self, facts: StationFacts) -> _Ages:
        newest = [
            port.newest.moment
            for (name, _), port in self.samples.ports.items()
            if name == facts.name and port.newest
        ]
        now_s = self.clock.now_s
        now_us = None if now_s is None else now_s * 1e6 - self.events.host_offset_us
        return _Ages(now_us, max(newest, default=None), facts.period_s)


@dataclass(frozen=True, slots=True)
class _Ages:
    """Ages of a station's readings: of the newest row by the run's clock (`now_us`), of older ones
    by tick.
    """

    now_us: float | None
    newest: Moment | None
    period_s: float | None

    @property
    def limit_s(self) -> float:
        return COMMIT_S + (STALE_PERIODS * self.period_s if self.period_s else NO_GRID_S)

    def age_s(self, moment: Moment) -> float | None:
        """Return the age in s; None if the clock was set back."""
        if self.now_us is None or self.newest is None:
            return None
        newest_s = (self.now_us - self.newest.time) / 1e6
        if newest_s < -CLOCK_S:
            return None
        before = (
            (self.newest.tick - moment.tick) * self.period_s
            if self.period_s
            else (self.newest.time - moment.time) / 1e6
        )
        return max(newest_s, 0.0) + max(before, 0.0)

    def reading(
        self, history: PortHistory, column: str, why_old: str | None, *, is_old: bool
    ) -> Reading:
        """Return the newest reading of a column.

        `is_old`: no recorder is running (for the reason `why_old`, if known), or the port's newest
        row is too old.
        """
        value, failure = history.values.get(column), history.failures.get(column)
        is_failed = failure is not None and (
            value is None or failure.moment.tick > value.moment.tick
        )
        age = None if value is None else self.age_s(value.moment)
        is_missed = is_failed and self.is_behind(value, failure and failure.moment)
        is_old = is_old or (column == MAIN and (is_missed or self.is_old(value)))
        return Reading(
            None if value is None else value.value,  # type: ignore[arg-type]  # the schema has no other types
            age,
            str(failure.value) if failure is not None and is_failed else why_old,
            is_old,
        )

    def is_behind(self, last: Last | None, known: Moment | None) -> bool:
        """Whether a row is more than two periods older than the station's newest; no later commit
        fills that gap.
        """
        if self.period_s is None or last is None or known is None:
            return False
        return known.tick - last.moment.tick > STALE_PERIODS

    def is_old(self, last: Last | None) -> bool:
        """Whether a value is too old to count as known."""
        age = None if last is None else self.age_s(last.moment)
        return age is None or age > self.limit_s


def _unknown_setting(setting: Reading) -> tuple[str, ...]:
    """Report an unknown setpoint: without it, a temperature cannot be judged."""
    return () if setting.is_known else (f"The set temperature is not known: {setting.why}.",)


def _condition(
    facts: StationFacts,
    phase: Phase,
    main: Reading,
    quality: str | None,
    *,
    is_fresh: bool,
    has_alarms: bool,
    has_problems: bool,
) -> Condition:
    if facts.unsafe or facts.outcome not in (StationOutcome.RUNNING, StationOutcome.COMPLETED):
        return Condition.FAILED
    if facts.outcome == StationOutcome.COMPLETED:
        return Condition.ENDED
    if has_alarms:
        return Condition.ALARM
    if quality is None and phase in (Phase.STARTING, Phase.RECORDING):
        return Condition.NOT_KNOWN
    if not is_fresh:
        return Condition.STALE
    if main is not NOT_SUPPORTED and not main.is_known:
        return Condition.STALE if main.is_stale else Condition.NOT_KNOWN
    return Condition.NORMAL if quality == "ok" and not has_problems else Condition.ATTENTION
