"""The state of a run at one moment, as frozen data classes. Unknown is never shown as normal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Final

from jbclog.core.rows import EventRow


class Phase(StrEnum):
    """Phase of a run, as a follower sees it."""

    STARTING = "starting"  # no commit yet
    RECORDING = "recording"
    DELAYED = "delayed"  # the recorder is alive and has not committed for a while
    FINALIZING = "finalizing"
    FINALIZED = "finalized"
    CRASHED = "crashed"  # the recorder ended without finalizing
    UNREADABLE = "unreadable"
    GONE = "gone"  # the folder was removed


class Condition(StrEnum):
    """Condition of a port, the worst first."""

    ALARM = "alarm"
    FAILED = "failed"  # the station did not complete its part of the run
    STALE = "stale"  # the newest reading is too old, or no recorder is running
    NOT_KNOWN = "not known"  # the newest reading has no value
    ATTENTION = "attention"  # a value or the station needs attention
    NORMAL = "normal"
    ENDED = "ended"


RUN_ENDED: Final = "run ended"


@dataclass(frozen=True, slots=True)
class Reading:
    """The newest reading of a signal.

    `age_s` is the age of `value`; `why` is the reason why there is no newer value. `is_known`:
    there is a value, no newer reading failed, and it is not too old.
    """

    value: int | float | str | bool | None = None
    age_s: float | None = None
    why: str | None = None
    is_stale: bool = True

    @property
    def is_known(self) -> bool:
        return self.value is not None and self.why is None and not self.is_stale


NOT_READ = Reading(why="not read yet")


@dataclass(frozen=True, slots=True)
class Coverage:
    """Temperature readings obtained and due. `is_whole`: counted from the begin of the run."""

    due: int = 0
    obtained: int = 0
    is_whole: bool = False

    @property
    def share(self) -> float | None:
        return self.obtained / self.due if self.due else None


@dataclass(frozen=True, slots=True)
class Joints:
    """The joints of a port that had ended `age_s` seconds ago; `age_s` None: all joints.

    `count` is None while the number is not known, for the reason `why`; `found` is then a lower
    estimate that may include false ones.
    """

    count: int | None = None
    found: int = 0
    age_s: float | None = None
    why: str | None = None

    @property
    def is_awaited(self) -> bool:
        """Whether the first count is still to come."""
        return self == NOT_COUNTED

    @property
    def is_supported(self) -> bool:
        """Whether the tool can make joints: only tips do."""
        return self.why != OF_TIPS_ONLY


OF_TIPS_ONLY: Final = "not supported"
NOT_COUNTED = Joints(why="not counted yet")


@dataclass(frozen=True, slots=True)
class Trace:
    """Points of a port: seconds on the run's grid, and the values there; None: not read.

    In a run without a grid, the trace begins anew when the clock is set back.
    """

    seconds: tuple[float, ...] = ()
    temperature_c: tuple[float | None, ...] = ()
    power_permille: tuple[float | None, ...] = ()

    @property
    def last_s(self) -> float:
        """The newest row, in s; 0.0 without rows."""
        return self.seconds[-1] if self.seconds else 0.0


@dataclass(frozen=True, slots=True)
class Setting:
    """The last reading of a setting; `outcome` says why there is none."""

    port: int | None
    tool_name: str | None
    name: str
    value: str | None
    uom: str
    outcome: str


@dataclass(frozen=True, slots=True)
class Counter:
    """The last reading of a counter; without a value, `raw` has the reason."""

    port: int | None
    name: str
    value: float | None
    uom: str
    raw: str


@dataclass(frozen=True, slots=True)
class PortState:
    """The state of a port.

    `readings` has the columns of the samples; `alarms` and `problems` are sentences about the
    present; `alarms_so_far` counts all alarms, including cleared ones. `trace` is the last minute;
    `hour` has a mean for every five seconds of the last hour.
    """

    station: str
    port: int
    tool_name: str | None
    condition: Condition
    quality: str | None
    row_age_s: float | None
    readings: Mapping[str, Reading]
    alarms: tuple[str, ...]
    problems: tuple[str, ...]
    coverage: Coverage
    trace: Trace
    hour: Trace = Trace()
    joints: Joints = NOT_COUNTED
    alarms_so_far: int = 0

    def reading(self, column: str) -> Reading:
        return self.readings.get(column, NOT_READ)

    @property
    def temperature(self) -> Reading:
        return self.reading("temperature_c")

    @property
    def setpoint(self) -> Reading:
        return self.reading("setpoint_c")

    @property
    def power(self) -> Reading:
        return self.reading("power_permille")

    @property
    def status(self) -> Reading:
        return self.reading("status")


@dataclass(frozen=True, slots=True)
class StationState:
    """The state of a station. `outcome` is that of the manifest; `problems` are sentences about the
    present.
    """

    name: str
    family: str
    model: str | None
    outcome: str
    reason: str
    rate_hz: float | None
    recipe: str | None
    problems: tuple[str, ...]
    ports: tuple[PortState, ...]
    settings: tuple[Setting, ...] = ()
    counters: tuple[Counter, ...] = ()


@dataclass(frozen=True, slots=True)
class NumberedEvent:
    """An event with its number in the run."""

    seq: int
    event: EventRow


@dataclass(frozen=True, slots=True)
class RunState:
    """The state of a run.

    `text` explains the phase; `commit_age_s` is the time since the recorder last committed;
    `problems` concern the whole run; `events` are the newest ones, oldest first. `unit` is the one
    on the bench, if known; `units` is this one or, if no serials are read during the run, all named
    at its start. `is_whole`: everything since the begin of the run was read.
    """

    folder: Path
    phase: Phase
    text: str
    commit_age_s: float | None = None
    line: str | None = None
    operator: str | None = None
    order: str | None = None
    product: str | None = None
    unit: str | None = None
    units: tuple[str, ...] = ()
    start: str | None = None
    stop: str | None = None
    verdict: str | None = None
    exit_status: str | None = None
    stations: tuple[StationState, ...] = ()
    problems: tuple[str, ...] = ()
    events: tuple[NumberedEvent, ...] = field(default=(), repr=False)
    is_whole: bool = False

    @property
    def ports(self) -> tuple[PortState, ...]:
        return tuple(port for station in self.stations for port in station.ports)

    def station(self, name: str) -> StationState | None:
        return next((station for station in self.stations if station.name == name), None)
