"""The settings of a recipe as an ordered list for each port, and one for the station."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Final

from jbclog.config.load_recipe import SECTION_FAMILIES
from jbclog.config.recipe import COMMAND_OF, WHEN_OFF, Asked, Recipe, asked_in
from jbclog.core.quantities import OFF, Value, raw_share
from jbclog.core.toml import dotted
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.omega import ConditionRecord

_PLACE: Final = {setting: place for place, setting in enumerate(COMMAND_OF)}


@dataclass(frozen=True, slots=True)
class Setting:
    """One value to write. `port` None: the whole station. The tool is known only during the run.

    `command.name` is the name in the table `settings`; `key` is the key in the recipe. A share
    (`is_share`) is in per mille until `as_counted` converts it to the station's unit.
    """

    command: Command
    port: int | None
    value: Value
    key: str
    is_share: bool = False

    @property
    def unit(self) -> str:
        """The value's unit, with the base of a percentage."""
        return (
            f"‰ of the station's {str(self.command.share_of).replace('_', ' ')}"
            if self.is_share
            else self.command.unit
        )

    def shown(self) -> str:
        """Return the value with its unit."""
        return f"{self.value} {self.unit}" if self.is_share else self.command.shown(self.value)

    def as_counted(self, held: Mapping[str, Value]) -> Setting | None:
        """Return the setting with the number to send, computed from the station's values `held`;
        None if the base is unknown.
        """
        if not self.is_share:
            return self
        whole = held.get(str(self.command.share_of))
        if not isinstance(whole, int) or not isinstance(self.value, int) or whole <= 0:
            return None
        return replace(self, value=raw_share(self.value, whole), is_share=False)


def settings_for(recipe: Recipe, family: Family, port: int) -> list[Setting]:
    """Return the settings for `port` of a station of `family`, in the order explained in
    `recipe.py`.
    """
    return [setting for _, setting in _for_port(recipe, family, port)]


def station_settings_for(recipe: Recipe, family: Family) -> list[Setting]:
    """Return the settings of the whole station: ale's feeder. Empty for other families."""
    wanted = sorted(asked_in(recipe.feeder, ("feeder",)), key=lambda one: _PLACE[one.setting])
    return [setting for one in wanted if (setting := _setting(one, family, None)) is not None]


def condition_of(recipe: Recipe, family: Family) -> ConditionRecord | None:
    """Return the solder condition that the recipe sets on this `family`; None if it sets none."""
    if recipe.omega is None or family.name not in SECTION_FAMILIES["omega"]:
        return None
    return ConditionRecord(*(getattr(recipe.omega, one.name) for one in fields(ConditionRecord)))


def foreign_keys(recipe: Recipe, family: Family, ports: Collection[int] | None = None) -> list[str]:
    """Return the settings of the recipe that this station lacks, named as in the column `setting`
    (`unsupported`).

    Keys of other families' sections, by their command's name (``feeder_length``) or, if no driven
    family has that command, by their key (``omega.condition``); and keys of ports beyond `ports`
    (default: the family's), in full: ``port.3.temperature.select_c``.
    """
    return [
        *_of_other_families(recipe, family),
        *_of_other_ports(recipe, family, ports if ports is not None else family.ports),
    ]


def live_problems(
    recipe: Recipe, family: Family, port: int, held: Mapping[str, Value]
) -> list[str]:
    """Return problems of settings outside the limits that the station reported in `held`."""
    found = (
        (one, _live_problem(setting, held)) for one, setting in _for_port(recipe, family, port)
    )
    return [str(recipe.problem(one.key, text)) for one, text in found if text is not None]


def _live_problem(setting: Setting, held: Mapping[str, Value]) -> str | None:
    place, counted = f"{setting.shown()} on port {setting.port}", setting.as_counted(held)
    if counted is None:
        return f"{place} cannot be calculated: the station does not report that maximum"
    if setting.is_share:
        place = f"{place}, {counted.shown()},"
    if setting.command.within is None:
        return None
    value, (lowest, highest) = (
        counted.value,
        (held.get(name) if name else None for name in setting.command.within),
    )
    if not isinstance(highest, int):
        return (
            f"{place} cannot be checked: the station does not answer its"
            f" {setting.command.within[1].replace('_', ' ')}"
        )
    if isinstance(value, int) and value > highest:
        return f"{place} is above the station's maximum of {setting.command.shown(highest)}"
    if isinstance(value, int) and isinstance(lowest, int) and value < lowest:
        return f"{place} is below the station's minimum of {setting.command.shown(lowest)}"
    return None


def _for_port(recipe: Recipe, family: Family, port: int) -> list[tuple[Asked, Setting]]:
    # suction is part of the status
    air = {one.setting: one for one in asked_in(recipe.air, ("air",)) if one.setting in COMMAND_OF}
    asked = recipe.asked(port) | air
    wanted = sorted(asked.values(), key=lambda one: _place(one, asked))
    return [
        (one, setting) for one in wanted if (setting := _setting(one, family, port)) is not None
    ]


def _place(one: Asked, asked: Mapping[str, Asked]) -> float:
    """Return the setting's order; a delay that switches an alarm off comes before its limit."""
    alarm, _, _ = one.setting.rpartition(".")
    if one.value is OFF and alarm in WHEN_OFF:
        return _PLACE[f"{alarm}.limit_c"] - 0.5
    return _PLACE[one.setting]


def _setting(one: Asked, family: Family, port: int | None) -> Setting | None:
    command = family.commands.get(COMMAND_OF[one.setting])
    if command is None or not command.writable or not _belongs(one, family):
        return None
    # in the form the station reports it, so that the comparison is exact
    value = command.quantity.decode(command.quantity.encode(one.value))
    return Setting(command, port, value, dotted(one.key), command.share_of is not None)


def _belongs(one: Asked, family: Family) -> bool:
    return family.name in SECTION_FAMILIES[one.setting.partition(".")[0]]


def _of_other_families(recipe: Recipe, family: Family) -> Iterator[str]:
    yield from (
        COMMAND_OF[one.setting] for one in recipe.asked().values() if not _belongs(one, family)
    )
    for section in ("feeder", "air", "omega"):
        table = getattr(recipe, section)
        if table is not None and family.name not in SECTION_FAMILIES[section]:
            for one in asked_in(table, (section,)):
                yield COMMAND_OF.get(one.setting, one.setting)


def _of_other_ports(recipe: Recipe, family: Family, ports: Collection[int] | None) -> Iterator[str]:
    for port in recipe.ports_named():
        is_there = ports is None or port in ports
        yield from (
            dotted(one.key)
            for one in recipe.asked_of(port)
            if not (is_there and _belongs(one, family))
        )
