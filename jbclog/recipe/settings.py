"""What a recipe writes on one station: an ordered list of settings for each port, and one for the station itself."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Final

from jbclog.commands.command import Command
from jbclog.commands.family import Family
from jbclog.commands.omega_values import ConditionRecord
from jbclog.quantities import OFF, Value
from jbclog.recipe.checks import SECTION_FAMILIES
from jbclog.recipe.model import Asked, Recipe, asked_in
from jbclog.recipe.order import COMMAND_OF, WHEN_OFF
from jbclog.recipe.toml import dotted

_PLACE: Final = {setting: place for place, setting in enumerate(COMMAND_OF)}


@dataclass(frozen=True, slots=True)
class Setting:
    """One value to be written. `port` is None for the whole station; the tool is known at run time only.

    `command.name` is what stands in the column `setting`; `key` is where the value stands in the recipe.
    """

    command: Command
    port: int | None
    value: Value
    key: str


def settings_for(recipe: Recipe, family: Family, port: int) -> list[Setting]:
    """What is written on `port` of a station of `family`, in the order that `order.py` explains."""
    asked = recipe.asked(port)
    wanted = sorted(asked.values(), key=lambda one: _place(one, asked))
    return [setting for one in wanted if (setting := _setting(one, family, port)) is not None]


def station_settings_for(recipe: Recipe, family: Family) -> list[Setting]:
    """What is written once for the whole station: the feeder of ale. Empty for families without one."""
    wanted = sorted(asked_in(recipe.feeder, ("feeder",)), key=lambda one: _PLACE[one.setting])
    return [setting for one in wanted if (setting := _setting(one, family, None)) is not None]


def condition_of(recipe: Recipe, family: Family) -> ConditionRecord | None:
    """The solder condition that the recipe asks of a station of `family`; None where it asks for none."""
    if recipe.omega is None or family.name not in SECTION_FAMILIES["omega"]:
        return None
    return ConditionRecord(*(getattr(recipe.omega, one.name) for one in fields(ConditionRecord)))


def foreign_keys(recipe: Recipe, family: Family, ports: Collection[int] | None = None) -> list[str]:
    """What the recipe asks for and this station does not have, as it stands in the column `setting` (`unsupported`).

    Keys of other families' sections by their command's name (``feeder_length``) or, where no driven family has
    one, by their key (``air.temperature_c``); and keys of ports beyond `ports` (default: the family's), whole:
    ``port.3.temperature.select_c``.
    """
    return [*_of_other_families(recipe, family), *_of_other_ports(recipe, ports if ports is not None else family.ports)]


def live_problems(recipe: Recipe, port: int, max_c: Value | None, min_c: Value | None) -> list[str]:
    """Where the port's selected temperature is beyond what the station allows (R-MAT, R-MIT; None: not read)."""
    select = recipe.asked(port).get("temperature.select_c")
    if select is None or not isinstance(select.value, int):
        return []
    problems = []
    if isinstance(max_c, int) and select.value > max_c:
        problems.append(_beyond(recipe, select, port, f"above the station's maximum of {max_c} °C"))
    if isinstance(min_c, int) and select.value < min_c:
        problems.append(_beyond(recipe, select, port, f"below the station's minimum of {min_c} °C"))
    return problems


def _beyond(recipe: Recipe, select: Asked, port: int, text: str) -> str:
    return str(recipe.problem(select.key, f"{select.value} °C on port {port} is {text}"))


def _place(one: Asked, asked: Mapping[str, Asked]) -> float:
    """The setting's place in the order; a delay that switches an alarm off comes just before its limit."""
    alarm, _, _ = one.setting.rpartition(".")
    if one.value is OFF and alarm in WHEN_OFF:
        return _PLACE[f"{alarm}.limit_c"] - 0.5
    return _PLACE[one.setting]


def _setting(one: Asked, family: Family, port: int | None) -> Setting | None:
    command = family.commands.get(COMMAND_OF[one.setting])
    if command is None or not command.writable or family.name not in SECTION_FAMILIES[one.setting.partition(".")[0]]:
        return None
    # as the station will give it back, so that reading back and comparing is exact
    value = command.quantity.decode(command.quantity.encode(one.value))
    return Setting(command, port, value, dotted(one.key))


def _of_other_families(recipe: Recipe, family: Family) -> Iterator[str]:
    for section in ("feeder", "air", "omega"):
        table = getattr(recipe, section)
        if table is not None and family.name not in SECTION_FAMILIES[section]:
            for one in asked_in(table, (section,)):
                yield COMMAND_OF.get(one.setting, one.setting)


def _of_other_ports(recipe: Recipe, ports: Collection[int] | None) -> Iterator[str]:
    for port in recipe.ports_named():
        if ports is not None and port not in ports:
            for one in recipe.asked_of(port):
                yield dotted(one.key)
