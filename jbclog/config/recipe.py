"""A recipe, and the order in which its settings are written to a station.

`recipe_sections.py` has its tables; `load_recipe.py` checks the families' ranges and conflicts
between keys.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from jbclog.config.recipe_sections import PortSettings, RecipeTables
from jbclog.config.schema import CheckedFile, Table
from jbclog.core.quantities import Value
from jbclog.core.toml import KeyPath
from jbclog.protocol.commands.family import FAMILIES, Family

# The writing order lets a run stop anywhere without leaving the tool in a worse state:
#
# 1. Sleep and hibernation delay, the way to cool down: the safe state works whatever fails later.
# 2. Alarms, armed before heat. To switch one off, the delay goes first, so that a moved limit
#    cannot raise it; to switch one on, the limit goes first, and the delay arms it.
# 3. The sleep temperature, which is the setpoint of a sleeping tool, and adjust, which moves the
#    tip by up to 50 °C.
# 4. The selected temperature.
#
# Hot air: the work mode first, which defines the rest, then the flow, because a heater without air
# burns, and the temperature last. The session sets the tool's status after all settings. The feeder
# comes before the ports: clog detection, the solder wire and its motion, and the mode, which
# defines those numbers; no setting starts it.
#
# `CAN_HEAT` lists commands that can heat a working tool, `CANNOT_HEAT` the others. A run writes the
# latter on all stations before the former on any (`session/run/station_run.py`).

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
"""Recipe key of each setting (without ``port.N.``) and its command, in writing order."""

WHEN_OFF: Final = ("alarm.high", "alarm.low")
"""Alarms whose delay is written before their limit when it switches them off."""

CANNOT_HEAT: Final[Mapping[str, str]] = MappingProxyType(
    {
        "sleep_delay": "decides when a tool in the stand cools down",
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
"""Command -> why it heats no tool."""

CAN_HEAT: Final[Mapping[str, str]] = MappingProxyType(
    {
        "sleep_temperature": "is the setpoint of a tool that sleeps",
        "adjust": "moves a tip that is at work by up to 50 °C",
        "selected_temperature": "is the setpoint of a tip that is at work",
        "work_mode": "puts a profile's setpoints in place of the selected ones",
        "selected_air_flow": (
            "blows more hot air where the heater is on; and it comes behind the work mode"
        ),
        "selected_external_temperature": "is the setpoint of what the hot air is led by",
        "selected_air_temperature": "is the setpoint of the hot air",
        "status": "puts the tool to work",
        "store_condition": "decides what the machine does next with its hot iron",
    }
)
"""Command -> why it can heat a tool."""


USUAL_HZ = 10.0
PORTS = (1, 2, 3, 4)  # ports that a station can have
NO_SAFE_STATE = "none"
"""Settings of a family without a safe writing order (omega)."""


class Asked(NamedTuple):
    """One value of a recipe: the setting's key, its position in the file, and the value."""

    setting: str  # "alarm.high.limit_c", for any table that contains it
    key: KeyPath  # ("port", "2", "alarm", "high", "limit_c")
    value: Value


def asked_in(table: Table, at: KeyPath = ()) -> Iterator[Asked]:
    """Yield the values given in a table of settings and its subtables, in schema order."""
    for name in type(table).model_fields:
        value = getattr(table, name)
        if isinstance(value, Table):
            yield from asked_in(value, (*at, name))
        elif value is not None:
            key = (*at, name)
            yield Asked(".".join(map(str, key[2:] if at[:1] == ("port",) else key)), key, value)


class Recipe(RecipeTables, CheckedFile):
    """A checked recipe."""

    @property
    def name(self) -> str:
        return self.recipe.name

    @property
    def revision(self) -> int:
        return self.recipe.revision

    @property
    def families(self) -> tuple[str, ...]:
        return self.recipe.families

    def ports_named(self) -> tuple[int, ...]:
        """The ports with tables of their own."""
        return tuple(sorted(int(name) for name in self.port))

    def asked(self, port: int | None = None) -> dict[str, Asked]:
        """Return the values for a port, by setting (``"alarm.high.limit_c"``); the port's own
        tables take precedence.

        Without a port: the values for a port without tables of its own.
        """
        common = PortSettings.model_construct(
            **{name: getattr(self, name) for name in PortSettings.model_fields}
        )
        own = self.asked_of(port) if port is not None else ()
        return {asked.setting: asked for asked in (*asked_in(common), *own)}

    def asked_of(self, port: int) -> Iterator[Asked]:
        """Yield the values in the port's own tables."""
        for name, table in self.port.items():
            if int(name) == port:
                yield from asked_in(table, ("port", name))

    def heated_ports(self) -> frozenset[int]:
        """The ports whose temperature the recipe sets."""
        if self.air.temperature_c is not None:
            return frozenset(PORTS)
        return frozenset(port for port in PORTS if "temperature.select_c" in self.asked(port))

    def safe_state(self, family: str) -> str:
        """Return the safe state of touched tools of this family (docs/reference/safe-states.md)."""
        known = FAMILIES.get(family)
        if "safe_state" in self.run.model_fields_set or known is None:
            return self.run.safe_state
        return known.safe_states[0] if known.safe_states else NO_SAFE_STATE

    def asked_rate(self, family: Family | None) -> float | str:
        """Return the rate of the fast signals: Hz or ``auto``; the family's unless the recipe sets
        one.
        """
        return self.sampling.rate_hz or self._usual_hz(family)

    @property
    def suction(self) -> str:
        """What the start of a run does to a hot air station's suction: ``keep``, ``on`` or
        ``off``.
        """
        return self.air.suction or "keep"

    def rate_hz(self, family: Family | None) -> float:
        """Return the highest rate of the fast signals: the recipe's, or the family's (None for
        most).
        """
        asked = self.sampling.rate_hz
        return asked if isinstance(asked, float) else self._usual_hz(family)

    @staticmethod
    def _usual_hz(family: Family | None) -> float:
        return USUAL_HZ if family is None else family.rate_hz
