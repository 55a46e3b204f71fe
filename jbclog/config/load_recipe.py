"""Read and check a recipe file, reporting all its mistakes."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from jbclog.config.recipe import COMMAND_OF, Asked, Recipe, asked_in
from jbclog.config.recipe_sections import RecipeTables
from jbclog.config.schema import read_file, read_table
from jbclog.core.errors import Problem, Problems
from jbclog.core.quantities import OFF
from jbclog.core.toml import KeyPath, TomlText, parse, read_text, shortened
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.commands.ranges import range_problem

# Checks beyond the schema: the families' ranges and steps, and conflicts between keys.
#
# Only values printed in a manual limit a setting (`Command.limits`). The station alone knows its
# highest and lowest temperature; `recipe_settings.live_problems` checks those once they are read.

SOLDERING: Final = tuple(
    name for name, family in FAMILIES.items() if "sleep_delay" in family.commands
)
SECTION_FAMILIES: Final[Mapping[str, tuple[str, ...]]] = {
    "temperature": SOLDERING,
    "sleep": SOLDERING,
    "hibernation": SOLDERING,
    "alarm": SOLDERING,
    "port": SOLDERING,
    "feeder": tuple(name for name, family in FAMILIES.items() if family.has_feeder),
    "air": tuple(
        name for name, family in FAMILIES.items() if "selected_air_temperature" in family.commands
    ),
    "omega": tuple(
        name for name, family in FAMILIES.items() if "store_condition" in family.commands
    ),
}
"""Families to which a section of settings applies."""

LIMIT_FAMILIES: Final[Mapping[str, tuple[str, ...]]] = {
    "recovery_p95_s": SOLDERING,
    "recovered_before_next_percent": SOLDERING,
    "joints_against_counter_percent": SECTION_FAMILIES["feeder"],
    "reached_within_c": (*SOLDERING, *SECTION_FAMILIES["air"]),
    "at_work_percent": (*SOLDERING, *SECTION_FAMILIES["air"]),
}
"""Families to which a limit of `[acceptance]` applies."""

SAFE_STATES: Final[Mapping[str, tuple[str, ...]]] = {
    name: family.safe_states for name, family in FAMILIES.items()
}
STATUSES: Final[Mapping[str, tuple[str, ...]]] = {
    name: family.run_statuses for name, family in FAMILIES.items()
}
WITH_SUCTION: Final = tuple(name for name, family in FAMILIES.items() if family.status.has_suction)
# no joint takes ten minutes of solder wire; a misplaced decimal point does
LONGEST_FEED_S: Final = 600.0
COOLING_DELAYS: Final = ("sleep.delay_min", "hibernation.delay_min")


def problems_between(recipe: Recipe) -> Iterator[Problem]:
    """Return the problems of a recipe whose keys have the right types."""
    yield from _foreign_sections(recipe)
    yield from _foreign_ports(recipe)
    yield from _out_of_range(recipe)
    yield from _states(recipe)
    for port in (None, *recipe.ports_named()):
        yield from _temperatures(recipe, recipe.asked(port))
    yield from _feeder(recipe)
    if not recipe.run.allow_no_cooldown:
        yield from no_cooldown(recipe)
    yield from _foreign_limits(recipe)
    limits = recipe.source.tables.get("acceptance")
    if isinstance(limits, Mapping) and not set(limits) - {"confidence"}:
        yield recipe.problem(
            ("acceptance",), "names no limit; without the table the run is not judged"
        )


def no_cooldown(recipe: Recipe) -> Iterator[Problem]:
    """Yield the delays that the recipe switches off while its safe state, or the fallback, may be
    stand, which would then never cool.
    """
    families = [FAMILIES[name] for name in recipe.families if name in FAMILIES]
    if not any(family.may_stand_at_last(recipe.safe_state(family.name)) for family in families):
        return
    for port in (None, *recipe.ports_named()):
        asked = recipe.asked(port)
        for one in (asked[key] for key in COOLING_DELAYS if key in asked):
            if one.value is OFF:
                yield recipe.problem(
                    one.key,
                    'is "off", so a tool in stand never cools; give minutes, or'
                    " run.allow_no_cooldown = true",
                )


def _foreign_sections(recipe: Recipe) -> Iterator[Problem]:
    for section, families in SECTION_FAMILIES.items():
        if (section,) in recipe.source.lines and not set(families) & set(recipe.families):
            listed, belongs = ", ".join(recipe.families), ", ".join(families)
            yield recipe.problem(
                (section,), f"fits none of the families listed ({listed}); it is for {belongs}"
            )


def _foreign_limits(recipe: Recipe) -> Iterator[Problem]:
    for name, families in LIMIT_FAMILIES.items():
        if getattr(recipe.acceptance, name, None) is not None and not set(families) & set(
            recipe.families
        ):
            listed, belongs = ", ".join(recipe.families), ", ".join(families)
            text = f"fits none of the families listed ({listed}); it is for {belongs}"
            yield recipe.problem(("acceptance", name), text)


def _foreign_ports(recipe: Recipe) -> Iterator[Problem]:
    families = [FAMILIES[name] for name in recipe.families if name in FAMILIES]
    for port in recipe.ports_named():
        if families and not any(
            family.ports is None or port in family.ports for family in families
        ):
            yield recipe.problem(
                ("port", str(port)),
                f"none of the families listed ({', '.join(recipe.families)}) has a port {port}",
            )


def _out_of_range(recipe: Recipe) -> Iterator[Problem]:
    families = [FAMILIES[name] for name in recipe.families if name in FAMILIES] or list(
        FAMILIES.values()
    )
    for one in _everything_asked(recipe):
        name = COMMAND_OF.get(one.setting)
        commands = (
            [family.commands[name] for family in families if name in family.commands]
            if name
            else []
        )
        problem = next(
            (
                text
                for command in commands
                if (text := range_problem(command, one.value)) is not None
            ),
            None,
        )
        if problem is not None:
            yield recipe.problem(one.key, problem)


def _everything_asked(recipe: Recipe) -> Iterator[Asked]:
    yield from recipe.asked().values()
    for port in recipe.ports_named():
        yield from recipe.asked_of(port)
    yield from asked_in(recipe.feeder, ("feeder",))
    yield from asked_in(recipe.air, ("air",))


def _states(recipe: Recipe) -> Iterator[Problem]:
    run = recipe.run
    if "safe_state" in run.model_fields_set:
        yield from _state(recipe, "safe_state", run.safe_state, SAFE_STATES)
    if run.status is not None:
        yield from _state(recipe, "status", run.status, STATUSES)
    if "safe_suction" in run.model_fields_set and not set(WITH_SUCTION) & set(recipe.families):
        listed, belongs = ", ".join(recipe.families), ", ".join(WITH_SUCTION)
        yield recipe.problem(
            ("run", "safe_suction"),
            f"fits none of the families listed ({listed}); it is for {belongs}",
        )


def _state(
    recipe: Recipe, key: str, state: str, table: Mapping[str, tuple[str, ...]]
) -> Iterator[Problem]:
    for family in recipe.families:
        if state not in table[family]:
            possible = ", ".join(table[family]) or "nothing"
            yield recipe.problem(
                ("run", key),
                f'"{state}" is not allowed on {family}, which the recipe lists; it allows'
                f" {possible}",
            )


def _temperatures(recipe: Recipe, asked: Mapping[str, Asked]) -> Iterator[Problem]:
    """Yield contradictions between a port's limits and temperatures; ignores disabled alarms."""
    select, sleep = asked.get("temperature.select_c"), asked.get("sleep.temperature_c")
    high, low = _armed(asked, "high"), _armed(asked, "low")
    yield from _below(recipe, select, high, "must be above", "must be below")
    yield from _below(recipe, low, select, "must be above", "must be below")
    yield from _below(recipe, low, high, "must be above", "must be below")
    yield from _below(recipe, sleep, select, "must not be below", "must not be above", equal=True)


def _armed(asked: Mapping[str, Asked], side: str) -> Asked | None:
    delay = asked.get(f"alarm.{side}.delay_s")
    return None if delay is not None and delay.value is OFF else asked.get(f"alarm.{side}.limit_c")


def _below(
    recipe: Recipe,
    low: Asked | None,
    high: Asked | None,
    above: str,
    below: str,
    *,
    equal: bool = False,
) -> Iterator[Problem]:
    """Yield a problem unless `low` is below `high`: at the port's own key if it has one, else at
    the limit's.
    """
    if (
        low is None
        or high is None
        or not isinstance(low.value, int)
        or not isinstance(high.value, int)
    ):
        return
    if low.value < high.value or (equal and low.value == high.value):
        return
    blame_low = _rank(low) >= _rank(high)
    one, other = (low, high) if blame_low else (high, low)
    yield recipe.problem(
        one.key,
        f"{one.value} °C {below if blame_low else above} {other.setting} ({other.value} °C)",
    )


def _rank(one: Asked) -> tuple[bool, bool]:
    return one.key[0] == "port", one.setting != "temperature.select_c"


def _feeder(recipe: Recipe) -> Iterator[Problem]:
    """Yield contradictory lengths and speeds."""
    feeder = recipe.feeder
    if (
        feeder.length_mm is not None
        and feeder.backward_mm is not None
        and feeder.backward_mm > feeder.length_mm
    ):
        yield recipe.problem(
            ("feeder", "backward_mm"),
            f"pulls back more than feeder.length_mm ({feeder.length_mm:g} mm) feeds",
        )


def long_feed(recipe: Recipe) -> str | None:
    """Return a warning for the plan if one feed takes very long: no manual prints a maximum."""
    feeder = recipe.feeder
    if (
        feeder.length_mm is None
        or feeder.speed_mm_s is None
        or feeder.length_mm / feeder.speed_mm_s <= LONGEST_FEED_S
    ):
        return None
    seconds, at = feeder.length_mm / feeder.speed_mm_s, feeder.speed_mm_s
    return (
        f"feeder.length_mm: one feed takes {seconds:.0f} s at {at:g} mm/s; is the decimal point"
        " where it belongs?"
    )


def warnings(recipe: Recipe) -> list[Problem]:
    """Return warnings about allowed but unusual values, for display before a run."""
    return list(dict.fromkeys(no_cooldown(recipe))) if recipe.run.allow_no_cooldown else []


IS_A_LINE: Final = "this is a line file; a recipe has [recipe] and what is asked of the stations"
_PLACEHOLDER: Final[dict[str, object]] = {
    "name": "unnamed",
    "revision": 0,
    "families": list(FAMILIES),
}


def load_recipe(path: Path, *, links: bool = True) -> Recipe:
    """Read a recipe; `links` as in `open_regular`. Raises Problems with all its mistakes."""
    return parse_recipe(read_text(path, links=links), path)


def parse_recipe(text: str, path: Path = Path("recipe.toml")) -> Recipe:
    """Parse a recipe; `path` appears in messages."""
    source = parse(text, str(path))
    if "recipe" not in source.tables and {"line", "station"} & source.tables.keys():
        raise Problems([Problem(source.file, None, "", IS_A_LINE)])
    tables, problems, keys = read_file(RecipeTables, source)
    whole = tables if tables is not None else _valid_part(source, keys)
    if whole is not None:
        problems += problems_between(_recipe(whole, source))
    if problems or tables is None:
        raise Problems(shortened(problems))
    return _recipe(tables, source)


def _recipe(tables: RecipeTables, source: TomlText) -> Recipe:
    return Recipe.model_construct(
        **{name: getattr(tables, name) for name in RecipeTables.model_fields}, source=source
    )


def _valid_part(source: TomlText, wrong: list[KeyPath]) -> RecipeTables | None:
    """Return the recipe without its wrong keys, so that conflicts of the others are reported,
    too.
    """
    data = copy.deepcopy(source.tables)
    for key in reversed(wrong):  # from the end, so that indexes of lists stay valid
        _drop(data, source.known(key))
    head = data.get("recipe")
    data["recipe"] = {**_PLACEHOLDER, **(head if isinstance(head, dict) else {})}
    return read_table(RecipeTables, source, (), data)[0]


def _drop(tables: dict[str, object], key: KeyPath) -> None:
    """Remove `key` from `tables`. Keep a `[recipe]` table that only lacks a key: a stand-in fills
    it.
    """
    if not key or (key == ("recipe",) and isinstance(tables.get("recipe"), dict)):
        return
    table: object = tables
    for part in key[:-1]:
        table = _member(table, part)
    last = key[-1]
    if isinstance(table, dict):
        table.pop(last, None)
    elif isinstance(table, list) and isinstance(last, int) and last < len(table):
        del table[last]


def _member(table: object, part: str | int) -> object:
    if isinstance(table, dict):
        return table.get(part)
    if isinstance(table, list) and isinstance(part, int) and part < len(table):
        return table[part]
    return None
