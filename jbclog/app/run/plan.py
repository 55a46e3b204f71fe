"""Plans a run from files and options.

`make_plan` reads the line file and the recipes and checks everything that can be checked without
sending a byte; it reports all mistakes at once. `tasks.py` turns a plan into the tasks of the
sessions.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from jbclog.app.run.options import Metadata, RunOptions
from jbclog.config.line import IS_A_RECIPE, Line, StationSpec, load_line
from jbclog.config.load_recipe import IS_A_LINE, load_recipe, long_feed
from jbclog.config.recipe import Recipe
from jbclog.config.recipe_settings import (
    Setting,
    condition_of,
    foreign_keys,
    settings_for,
    station_settings_for,
)
from jbclog.core.errors import Problem, Problems, UsageError, problems_of
from jbclog.core.text import file_name
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.protocol.commands.omega import ConditionRecord
from jbclog.protocol.commands.ranges import inferred_note, unit_note
from jbclog.session.rates import (
    AS_FAST_AS_POSSIBLE,
    asked_rate,
    rate_problem,
    readings_for,
    response,
    taken_rate_hz,
)
from jbclog.session.scheduler import Demand

WORK = ("working", "on")  # statuses that heat
PORTS = (1, 2, 3, 4)  # port numbers of any station
ANSWERING_PORTS = (1,)  # assumed if only the station knows its ports


@dataclass(frozen=True, slots=True)
class StationPlan:
    """Plan of one station. `family` is None for "auto". `ports` are the assumed ones."""

    spec: StationSpec
    family: Family | None
    ports: tuple[int, ...]
    recipe: Recipe
    recipe_file: str
    rate: float | str | None
    demand: Demand | None

    @property
    def turnaround_s(self) -> float:
        """Response time of the line file, or 0 (docs/reference/configuration.md)."""
        return (self.spec.turnaround_ms or 0.0) / 1000

    @property
    def slowest_s(self) -> float | None:
        """Longest response time in the family's manual, in s; None if it states none."""
        return (
            None
            if self.family is None or self.family.turnaround_ms is None
            else self.family.turnaround_ms[1] / 1000
        )

    @property
    def asked_rate(self) -> float | str:
        """Requested rate, by `--rate` or the recipe: Hz, ``auto``, ``fit`` or ``max``."""
        return asked_rate(self.rate, self.recipe, self.family)

    @property
    def rate_hz(self) -> float | None:
        """Rate at the assumed response time; 0.0: none fits, None: no pauses or unknown."""
        asked = self.asked_rate
        if not isinstance(asked, str):
            return asked
        if asked == AS_FAST_AS_POSSIBLE or self.family is None or self.demand is None:
            return None
        # nothing is measured yet: median and longest are the same
        assumed = response(self.family, self.turnaround_s, self.turnaround_s)
        return taken_rate_hz(asked, self.recipe, self.family, self.demand, assumed)

    def writes(self) -> list[Setting]:
        """Return every setting for this station, in order; those already in place will not be
        written.
        """
        if self.family is None:
            return []
        found = station_settings_for(self.recipe, self.family)
        for port in self.ports:
            found += settings_for(self.recipe, self.family, port)
        return found

    def setting_notes(self) -> Iterator[str]:
        """Yield limits and units inferred from another manual, once for each key of the recipe, and
        a long feed.
        """
        if self.family is None:
            return
        for key, one in {one.key: one for one in self.writes()}.items():
            found = (
                unit_note(one.command, self.family.manual),
                inferred_note(one.command, one.value, self.family.manual),
            )
            yield from (f"{key}: {note}" for note in found if note is not None)
        if self.family.has_feeder and (feed := long_feed(self.recipe)) is not None:
            yield feed

    def condition(self) -> ConditionRecord | None:
        """Return the recipe's solder condition: read, compared, and written only if allowed."""
        return None if self.family is None else condition_of(self.recipe, self.family)

    def skipped(self) -> list[str]:
        """Return the keys of the recipe that this station does not have."""
        return (
            []
            if self.family is None
            else foreign_keys(self.recipe, self.family, self.spec.ports or self.family.ports)
        )


@dataclass(frozen=True, slots=True)
class Plan:
    """A checked run, before a byte is sent."""

    line: Line
    stations: tuple[StationPlan, ...]
    wanted: RunOptions

    @property
    def recipes(self) -> dict[str, Recipe]:
        """Recipes by their file name in the run's folder."""
        return {station.recipe_file: station.recipe for station in self.stations}

    @property
    def starts_without_missing(self) -> bool:
        """Whether the run starts without a station that is missing or refuses: all recipes say so,
        or the option does.
        """
        return self.wanted.allow_missing or all(
            one.recipe.run.on_missing == "continue" for one in self.stations
        )

    @property
    def notes(self) -> list[str]:
        """Notes on settings that are valid but may not be intended."""
        plain = [
            *self._without_safe_state(),
            *self._not_put_to_work(),
            *self._differing_on_missing(),
        ]
        settings = [
            f"{station.spec.name}: {note}"
            for station in self.stations
            for note in station.setting_notes()
        ]
        return [*plain, *settings, *self._asked_later()]

    def _differing_on_missing(self) -> Iterator[str]:
        asked = {one.recipe_file: one.recipe.run.on_missing for one in self.stations}
        if not self.starts_without_missing and "continue" in asked.values():
            stop = ", ".join(name for name, word in asked.items() if word == "stop")
            yield (
                f'on_missing = "continue" has no effect, {stop} has "stop": the run starts with all'
                " stations or not at all"
            )

    def _without_safe_state(self) -> Iterator[str]:
        for station in self.stations:
            if station.family is not None and not station.family.safe_states:
                yield (
                    f"{station.spec.name} has no safe state that can be set: it stays as it is,"
                    " whatever happens"
                )

    def _not_put_to_work(self) -> Iterator[str]:
        """Yield recipes that set a temperature without a status that heats."""
        for name, recipe in self.recipes.items():
            heats = any(
                one.family is None or one.family.run_statuses
                for one in self.stations
                if one.recipe is recipe
            )
            status, acceptance = recipe.run.status, recipe.acceptance
            is_meant = status in WORK or (acceptance is None and status is not None)
            if (
                not heats
                or not recipe.heated_ports()
                or is_meant
                or (acceptance and acceptance.at_work_percent == 0)
            ):
                continue
            ordered = "no [run] status" if status is None else f'[run] status = "{status}"'
            then = (
                "a cold tool is recorded" if acceptance is None else "the verdict is INCONCLUSIVE"
            )
            yield (
                f"{name} sets a temperature and has {ordered}: the run heats no tool, and if nobody"
                f' else does, {then}; status = "working" (hot air: "on") heats'
            )

    def _asked_later(self) -> Iterator[str]:
        if self.wanted.metadata is not None:
            return
        for recipe in self.recipes.values():
            missing = Metadata().missing(recipe.metadata.required)
            if missing:
                yield f"{recipe.path.name} requires {' '.join(missing)}: give it to `run`"


def make_plan(wanted: RunOptions) -> Plan:
    """Read and check everything. Raises `Problems` or `UsageError` with all mistakes (exit 2)."""
    try:
        line, recipes = _load_files(wanted)
        chosen = _chosen(line, wanted)
    except UsageError as error:
        if not wanted.mistakes:
            raise
        raise Problems([*wanted.mistakes, *problems_of(error)]) from error
    stations = tuple(
        station_plan(spec, recipes[spec.name], wanted) for spec in chosen if spec.name in recipes
    )
    problems = [
        *wanted.mistakes,
        *_without_recipe(line, chosen, recipes),
        *_unused(line, chosen, wanted),
        *(problem for station in stations for problem in _mismatches(line, station)),
        *_missing_metadata(stations, wanted),
        *_misplaced_tips(chosen, wanted),
        *_out_of_reach(stations, wanted),
    ]
    if problems:
        raise Problems(problems)
    return Plan(line, _with_file_names(stations), wanted)


# -- files -----------------------------------------------------------------------------------------


def _load_files(wanted: RunOptions) -> tuple[Line, dict[str, Recipe]]:
    """Return the line file, and each station's recipe by name.

    Raises `Problems` or `UsageError` with the mistakes of all files.
    """
    problems: list[Problem] = []
    line = _load_line(wanted, problems)
    recipes = _load_recipes(wanted, line, problems)
    if [problem.text for problem in problems] == [IS_A_RECIPE, IS_A_LINE]:
        raise UsageError(f"{wanted.line} is a recipe and {wanted.recipe} a line file: swap them")
    if line is None or problems:
        raise Problems(problems)
    return line, recipes


def _load_line(wanted: RunOptions, problems: list[Problem]) -> Line | None:
    try:
        return load_line(wanted.line)
    except Problems as error:
        problems += error.problems
        return None


def _load_recipes(
    wanted: RunOptions, line: Line | None, problems: list[Problem]
) -> dict[str, Recipe]:
    """Return station -> recipe: its own, or the given one. Reads each file once."""
    read: dict[Path, Recipe | None] = {}
    found: dict[str, Recipe] = {}

    def recipe_at(path: Path) -> Recipe | None:
        if path not in read:
            try:
                read[path] = load_recipe(path)
            except Problems as error:
                problems.extend(error.problems)
                read[path] = None
        return read[path]

    if wanted.recipe is not None:
        recipe_at(wanted.recipe)  # also if no station uses it, to report its mistakes
    for spec in line.stations if line else ():
        path = spec.recipe or wanted.recipe
        recipe = None if path is None else recipe_at(path)
        if recipe is not None:
            found[spec.name] = recipe
    return found


def _chosen(line: Line, wanted: RunOptions) -> list[StationSpec]:
    names = [spec.name for spec in line.stations]
    unknown = [name for name in wanted.stations if name not in names]
    if unknown:
        raise UsageError(
            f"{line.path}: no station named {', '.join(unknown)}; the line has {', '.join(names)}"
        )
    return [spec for spec in line.stations if not wanted.stations or spec.name in wanted.stations]


def station_plan(spec: StationSpec, recipe: Recipe, wanted: RunOptions) -> StationPlan:
    """Return the plan of one station."""
    family = None if spec.family == "auto" else FAMILIES[spec.family]
    ports = spec.ports or (family.ports if family else None) or ANSWERING_PORTS
    demand = None
    if family is not None:
        demand = Demand.of(
            readings_for(family, ports, recipe, spec.line_format, spec.address is not None)
        )
    return StationPlan(spec, family, ports, recipe, recipe.path.name, wanted.rate, demand)


def _with_file_names(stations: tuple[StationPlan, ...]) -> tuple[StationPlan, ...]:
    """Give each recipe its own file name in the run's folder, which every file system allows; names
    in two folders may be equal, and on Windows those that differ in case only.
    """
    names: dict[Path, str] = {}
    taken: set[str] = set()
    for station in stations:
        path = station.recipe.path
        if path in names:
            continue
        name, number = file_name(path.name), 2
        while name.casefold() in taken:
            name, number = file_name(f"{path.stem}-{number}{path.suffix}"), number + 1
        names[path] = name
        taken.add(name.casefold())
    return tuple(replace(one, recipe_file=names[one.recipe.path]) for one in stations)


# -- checks ----------------------------------------------------------------------------------------


def _without_recipe(
    line: Line, chosen: list[StationSpec], recipes: dict[str, Recipe]
) -> Iterator[Problem]:
    for spec in chosen:
        if spec.name not in recipes:
            yield Problem(
                str(line.path),
                None,
                f"station {spec.name}",
                "has no recipe: give one on the command line or in the file",
            )


def _unused(line: Line, chosen: list[StationSpec], wanted: RunOptions) -> Iterator[Problem]:
    """Yield a problem if no station would use the given recipe: the user expects it to be
    applied.
    """
    own = [os.path.realpath(spec.recipe) for spec in chosen if spec.recipe is not None]
    if (
        wanted.recipe is not None
        and len(own) == len(chosen)
        and os.path.realpath(wanted.recipe) not in own
    ):
        text = (
            f"is used by no station: each one that runs has its own recipe in {line.path}; leave it"
            " out, or choose other stations"
        )
        yield Problem(str(wanted.recipe), None, "", text)


def _mismatches(line: Line, station: StationPlan) -> Iterator[Problem]:
    spec, recipe = station.spec, station.recipe
    if station.family is not None and station.family.name not in recipe.families:
        families = ", ".join(recipe.families)
        yield recipe.problem(
            ("recipe", "families"),
            f"{families}: not for {spec.name}, whose family is {spec.family}",
        )
        return
    demand, rate_hz = station.demand, station.rate_hz
    if demand is None or rate_hz is None:
        return
    problem = rate_problem(spec.name, rate_hz, demand, station.turnaround_s)
    if problem:
        yield Problem(
            str(line.path), None, f"station {spec.name}", problem.removeprefix(f"{spec.name}: ")
        )


def _missing_metadata(stations: Sequence[StationPlan], wanted: RunOptions) -> Iterator[Problem]:
    for recipe in {id(one.recipe): one.recipe for one in stations}.values():
        missing = wanted.metadata.missing(recipe.metadata.required) if wanted.metadata else []
        if missing:
            yield recipe.problem(("metadata", "required"), f"give {' '.join(missing)}")


def _out_of_reach(stations: Sequence[StationPlan], wanted: RunOptions) -> Iterator[Problem]:
    """Yield goals that this run can never reach."""
    if (
        wanted.until_units is not None
        and wanted.metadata is not None
        and not wanted.metadata.reads_units
    ):
        text = "serials must be read during the run: give --units -, a pipe or a device"
        yield Problem(f"--until-units {wanted.until_units}", None, "", text)
    if (
        wanted.until_joints is not None
        and stations
        and all(_shows_no_joints(one.family) for one in stations)
    ):
        text = "no station of this run has a tip that shows joints by temperature and power"
        yield Problem(f"--until-joints {wanted.until_joints}", None, "", text)


def _shows_no_joints(family: Family | None) -> bool:
    """Whether the station cannot show joints: hot air has no contact, OMEGA reports neither value.
    "auto" is not known yet.
    """
    return family is not None and (
        family.hot_part != "tip" or family.command_of("power_permille") is None
    )


def _misplaced_tips(chosen: Sequence[StationSpec], wanted: RunOptions) -> Iterator[Problem]:
    """Yield tips for a station or port that this run does not have."""
    places = {spec.name for spec in chosen} | {
        f"{spec.name}:{port}" for spec in chosen for port in spec.ports or PORTS
    }
    for text in wanted.metadata.tips if wanted.metadata else ():
        place, equals, name = text.partition("=")
        if equals and (place not in places or not name):
            names = ", ".join(spec.name for spec in chosen)
            yield Problem(
                f"--tip {text}",
                None,
                "",
                f"give ID, STATION=ID or STATION:PORT=ID, with a station of this run: {names}",
            )
