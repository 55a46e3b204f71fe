"""Which command writes which key of a recipe, and in what order a port is written.

The order is the one in which a run may stop at any place and leave the tool no worse than it was:

1. Sleep and hibernation delay: the way to cool down. Whatever fails later, the safe state that follows leads
   somewhere. Then the sleep temperature that it leads to.
2. Alarms: the guard stands before heat is asked for. An alarm that is switched off loses its delay first, so
   that moving its limit cannot set it off; one that is armed gets its limit first, and is armed by its delay.
3. Adjust, which moves the tip by up to 50 °C at the same setting.
4. The selected temperature last: it is the only one that heats.

On hot air the work mode comes first, which says what the rest means, then the flow, because a heater without air is
burnt, and the temperature last.

The tool's status is no setting and is ordered after all of these, by the session. The feeder is set up before
the ports: clog detection first, what the wire is and how it moves then, and the mode, which says what those
numbers mean, last; no setting starts it.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

COMMAND_OF: Final[Mapping[str, str]] = MappingProxyType(
    {
        "sleep.delay_min": "sleep_delay",
        "hibernation.delay_min": "hibernation_delay",
        "sleep.temperature_c": "sleep_temperature",
        "alarm.high.limit_c": "alarm_high_limit",
        "alarm.high.delay_s": "alarm_high_delay",
        "alarm.low.limit_c": "alarm_low_limit",
        "alarm.low.delay_s": "alarm_low_delay",
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
