"""Readings that become columns of `samples` and rows of `counters`, and their intervals
(docs/reference/configuration.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class ReadInterval(Enum):
    """How often a signal is due. The recipe sets the seconds of ALARMS and COUNTERS."""

    FAST = "every tick"
    ALARMS = "alarms_every_s"
    FIVE = "every 5 s"
    TEN = "every 10 s"
    COUNTERS = "counters_every_s"


@dataclass(frozen=True, slots=True)
class Signal:
    """A repeatedly read command and the columns that its answer fills, the first of which names the
    signal.
    """

    command: str
    columns: tuple[str, ...]
    interval: ReadInterval

    @property
    def name(self) -> str:
        return self.columns[0]


STATUS_COLUMNS = ("status", "cooling", "desoldering", "motor")

STATUS = Signal("status", STATUS_COLUMNS[:3], ReadInterval.FAST)
STATUS_WITH_MOTOR = Signal("status", STATUS_COLUMNS, ReadInterval.FAST)

SOLDERING_SIGNALS = (
    Signal("tip_temperature", ("temperature_c",), ReadInterval.FAST),
    Signal("power", ("power_permille",), ReadInterval.FAST),
    STATUS,
    Signal("alarm_flags", ("alarm_high", "alarm_low"), ReadInterval.ALARMS),
    Signal("port_error", ("port_error",), ReadInterval.ALARMS),
    Signal("selected_temperature", ("setpoint_c",), ReadInterval.FIVE),
    Signal("tool", ("tool",), ReadInterval.FIVE),
    Signal("station_error", ("station_error",), ReadInterval.FIVE),
    Signal("transistor_temperature", ("transistor_c",), ReadInterval.TEN),
    Signal("transformer_temperature", ("transformer_c",), ReadInterval.TEN),
    Signal("time_to_sleep", ("delay_s",), ReadInterval.TEN),
)
FEEDER_SIGNALS = (
    *(STATUS_WITH_MOTOR if signal is STATUS else signal for signal in SOLDERING_SIGNALS),
    Signal("feeding", ("feeding",), ReadInterval.ALARMS),
)


@dataclass(frozen=True, slots=True)
class UsageCounter:
    """A counter's command, and its name and unit in `counters`. It is due at the shorter of
    `interval` and COUNTERS.
    """

    command: str
    name: str
    unit: str
    interval: ReadInterval = ReadInterval.COUNTERS


HOUR_COUNTERS = (
    UsageCounter("plugged_hours", "plugged_h", "h"),
    UsageCounter("no_tool_hours", "no_tool_h", "h"),
    UsageCounter("sleep_hours", "sleep_h", "h"),
    UsageCounter("hibernation_hours", "hibernation_h", "h"),
    UsageCounter("work_hours", "work_h", "h"),
    UsageCounter("sleep_cycles", "sleep_cycles", "count"),
    UsageCounter("desolder_cycles", "desolder_cycles", "count"),
)
_DISPENSED_MM = UsageCounter("dispensed_length", "dispensed_mm", "mm")
DISPENSING_COUNTERS = (UsageCounter("dispensed_cycles", "dispensed_cycles", "count"), _DISPENSED_MM)
FEEDER_COUNTERS = (
    UsageCounter("dispensed_cycles", "dispensed_cycles", "count", ReadInterval.ALARMS),
    _DISPENSED_MM,
)
"""A feeder's cycles are read as often as its state, because each feed is evidence of a joint."""
