"""Which command writes which key of a recipe, and in what order a port is written.

The order is the one in which a run may stop at any place and leave the tool no worse than it was:

1. Sleep and hibernation delay: the way to cool down. Whatever fails later, the safe state that follows leads
   somewhere.
2. Alarms: the guard stands before heat is asked for. An alarm that is switched off loses its delay first, so
   that moving its limit cannot set it off; one that is armed gets its limit first, and is armed by its delay.
3. The sleep temperature, which is the setpoint of a tool that sleeps, and adjust, which moves the tip by up to 50 °C at
   the same setpoint.
4. The selected temperature last.

On hot air the work mode comes first, which says what the rest means, then the flow, because a heater without air is
burnt, and the temperature last.

The tool's status is no setting and is ordered after all of these, by the session. The feeder is set up before
the ports: clog detection first, what the wire is and how it moves then, and the mode, which says what those
numbers mean, last; no setting starts it.

What can heat a tool that is at work already is `CAN_HEAT`, all else `CANNOT_HEAT`: a run writes the second on all of its
stations before it writes the first on any of them (`session/run/station_run.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

COMMAND_OF: Final[Mapping[str, str]] = MappingProxyType(
    {
        "sleep.delay_min": "sleep_delay",
        "hibernation.delay_min": "hibernation_delay",
        "alarm.high.limit_c": "alarm_high_limit",
        "alarm.high.delay_s": "alarm_high_delay",
        "alarm.low.limit_c": "alarm_low_limit",
        "alarm.low.delay_s": "alarm_low_delay",
        "sleep.temperature_c": "sleep_temperature",
        "temperature.adjust_c": "adjust",
        "temperature.select_c": "selected_temperature",
        "air.mode": "work_mode",
        "air.flow_permille": "selected_air_flow",
        "air.external_set_c": "selected_external_temperature",
        "air.temperature_c": "selected_air_temperature",
        "feeder.clog_detection": "clog_detection",
        "feeder.diameter_mm": "feeder_diameter",
        "feeder.length_mm": "feeder_length",
        "feeder.backward_mm": "feeder_backward",
        "feeder.speed_mm_s": "feeder_speed",
        "feeder.mode": "feeder_mode",
    }
)
"""The setting's key in a recipe (without ``port.N.``) and the command that carries it, in the order of writing."""

WHEN_OFF: Final = ("alarm.high", "alarm.low")
"""Alarms whose delay goes before their limit where it switches them off."""

CANNOT_HEAT: Final[Mapping[str, str]] = MappingProxyType(
    {
        "sleep_delay": "decides when a tool that was told to stand cools down",
        "hibernation_delay": "decides when a tool that sleeps is switched off",
        "alarm_high_limit": "decides when the station raises its alarm",
        "alarm_high_delay": "decides when the station raises its alarm",
        "alarm_low_limit": "decides when the station raises its alarm",
        "alarm_low_delay": "decides when the station raises its alarm",
        "clog_detection": "decides when the feeder reports a clog",
        "feeder_diameter": "says what solder wire is fed when somebody starts the feeder",
        "feeder_length": "decides how much is fed when somebody starts the feeder",
        "feeder_backward": "decides how much is drawn back after feeding",
        "feeder_speed": "decides how fast is fed when somebody starts the feeder",
        "feeder_mode": "says what the feeder's numbers mean; only W-STR starts it",
    }
)
"""Command -> why it leaves every tool as warm as it is."""

CAN_HEAT: Final[Mapping[str, str]] = MappingProxyType(
    {
        "sleep_temperature": "is the setpoint of a tool that sleeps",
        "adjust": "moves a tip that is at work by up to 50 °C",
        "selected_temperature": "is the setpoint of a tip that is at work",
        "work_mode": "puts a profile's setpoints in place of the selected ones",
        "selected_air_flow": "blows more hot air where the heater is on; and it comes behind the work mode",
        "selected_external_temperature": "is the setpoint of what the hot air is led by",
        "selected_air_temperature": "is the setpoint of the hot air",
        "status": "puts the tool to work",
        "store_condition": "decides what the machine does next with its hot iron",
    }
)
"""Command -> why a tool can get warmer by it."""
