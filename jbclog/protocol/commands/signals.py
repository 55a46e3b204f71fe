"""Which readings become columns of `samples` and rows of `counters`, and how often (docs/reference/configuration.md)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Pace(Enum):
    """How often a signal is due. The seconds of ALARMS and COUNTERS come from the recipe."""

    FAST = "every tick"
    ALARMS = "alarms_every_s"
    FIVE = "every 5 s"
    TEN = "every 10 s"
    COUNTERS = "counters_every_s"


@dataclass(frozen=True, slots=True)
class Signal:
    """A command read repeatedly and the columns that its answer fills; the first column names the signal."""

    command: str
    columns: tuple[str, ...]
    pace: Pace

    @property
    def name(self) -> str:
        return self.columns[0]


STATUS_COLUMNS = ("status", "cooling", "desoldering", "motor")

STATUS = Signal("status", STATUS_COLUMNS[:3], Pace.FAST)
STATUS_WITH_MOTOR = Signal("status", STATUS_COLUMNS, Pace.FAST)

SOLDERING_SIGNALS = (
    Signal("tip_temperature", ("temperature_c",), Pace.FAST),
    Signal("power", ("power_permille",), Pace.FAST),
    STATUS,
    Signal("alarm_flags", ("alarm_high", "alarm_low"), Pace.ALARMS),
    Signal("port_error", ("port_error",), Pace.ALARMS),
    Signal("selected_temperature", ("set_c",), Pace.FIVE),
    Signal("tool", ("tool",), Pace.FIVE),
    Signal("station_error", ("station_error",), Pace.FIVE),
    Signal("transistor_temperature", ("transistor_c",), Pace.TEN),
    Signal("transformer_temperature", ("transformer_c",), Pace.TEN),
    Signal("time_to_sleep", ("delay_s",), Pace.TEN),
)
FEEDER_SIGNALS = (
    *(STATUS_WITH_MOTOR if signal is STATUS else signal for signal in SOLDERING_SIGNALS),
    Signal("feeding", ("feeding",), Pace.ALARMS),
)


@dataclass(frozen=True, slots=True)
class Counter:
    """A counter's command, its name in `counters` and its unit there. It is due no less often than `pace` and COUNTERS say."""

    command: str
    name: str
    unit: str
    pace: Pace = Pace.COUNTERS


HOUR_COUNTERS = (
    Counter("plugged_hours", "plugged_h", "h"),
    Counter("no_tool_hours", "no_tool_h", "h"),
    Counter("sleep_hours", "sleep_h", "h"),
    Counter("hibernation_hours", "hibernation_h", "h"),
    Counter("work_hours", "work_h", "h"),
    Counter("sleep_cycles", "sleep_cycles", "count"),
    Counter("desolder_cycles", "desolder_cycles", "count"),
)
_DISPENSED_MM = Counter("dispensed_length", "dispensed_mm", "mm")
DISPENSING_COUNTERS = (Counter("dispensed_cycles", "dispensed_cycles", "count"), _DISPENSED_MM)
FEEDER_COUNTERS = (Counter("dispensed_cycles", "dispensed_cycles", "count", Pace.ALARMS), _DISPENSED_MM)
"""Each feed is evidence of a joint, so where there is a feeder its cycles are read as often as its state."""
