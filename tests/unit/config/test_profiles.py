"""The lines, recipes and tasks that come with the project: they load, cover every family, and fit
their links and counters.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.config.line import StationSpec, load_line
from jbclog.config.load_recipe import load_recipe
from jbclog.config.recipe import Recipe
from jbclog.config.recipe_settings import condition_of, settings_for
from jbclog.config.tasks_file import DAYS, load_tasks
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.session.rates import IDENTITY_READS, WATCHED_SETTINGS, readings_for
from jbclog.session.scheduler import Demand

PROFILES = Path(__file__).parents[3] / "profiles"
LINES = sorted((PROFILES / "lines").glob("*.toml"))
RECIPES = sorted((PROFILES / "recipes").glob("*.toml"))
RATES_HZ = {"dme": 4, "omega": 1, "soldering-slow": 5}
"""What four ports, slow answers and 4800 baud come to."""
TASKS = PROFILES / "tasks" / "bench.toml"
THT = PROFILES / "recipes" / "sn100c-tht.toml"


def demand(recipe: Recipe, family: Family, ports: tuple[int, ...], line: LineFormat) -> Demand:
    """Of signals and counters alone."""
    others = {*IDENTITY_READS, *WATCHED_SETTINGS}
    readings = readings_for(family, ports, recipe, line, True)
    return Demand.of(reading for reading in readings if reading.name not in others)


def rate_hz(recipe: Recipe, station: StationSpec) -> float:
    """What the recipe takes on the station where it answers within a millisecond, or as slowly as
    its manual prints.
    """
    family = FAMILIES[station.family]
    ports = station.ports or family.ports
    assert ports is not None, f"{station.name} does not say which ports it has"
    assert recipe.sampling.rate_hz == "auto"
    longest_s = family.turnaround_ms[1] / 1000 if family.turnaround_ms else 0.001
    readings = readings_for(family, ports, recipe, station.line_format, station.address is not None)
    return Demand.of(readings).auto_rate_hz(0.001, longest_s)


@pytest.mark.parametrize("path", RECIPES, ids=lambda path: path.stem)
def test_a_recipe_loads_and_says_what_it_is_for(path: Path) -> None:
    recipe = load_recipe(path)
    assert recipe.name == path.stem
    assert recipe.text.startswith("# ")
    assert recipe.acceptance is not None
    for family in recipe.families:
        assert settings_for(recipe, FAMILIES[family], 1) or condition_of(recipe, FAMILIES[family])


@pytest.mark.parametrize("path", LINES, ids=lambda path: path.stem)
def test_a_line_loads_and_runs_on_virtual_stations_as_it_stands(path: Path) -> None:
    line = load_line(path)
    assert line.name == path.stem
    for station in line.stations:
        assert station.is_relative
        assert station.sim is not None
        assert station.sim.turnaround_ms == 1.0
        assert not FAMILIES[station.family].models or FAMILIES[station.family].proves(
            station.sim.model or station.family
        )
        recipe = load_recipe(station.recipe or THT)
        assert station.family in recipe.families
        assert rate_hz(recipe, station) == RATES_HZ.get(
            path.stem, 10 if station.ports in (None, (1,)) else 5
        )


def test_every_family_has_a_line_and_a_recipe() -> None:
    assert {path.stem for path in LINES} >= {*FAMILIES, "bench"}
    assert {path.stem.partition("-")[0].rstrip("0123456789") for path in LINES} == {
        *FAMILIES,
        "bench",
    }
    assert {family for path in RECIPES for family in load_recipe(path).families} == set(FAMILIES)


def test_every_family_that_counts_has_a_task_and_each_task_what_it_counts() -> None:
    tasks = load_tasks(TASKS)
    for name, family in FAMILIES.items():
        counts = {counter.name for counter in family.counters}
        assert not counts or any(one.is_of("", name) and one.counter in counts for one in tasks)
        named = {one.counter for one in tasks if one.families and name in one.families}
        assert named <= {*counts, DAYS}, name


def test_the_bench_is_the_one_that_the_demo_shows() -> None:
    stations = load_line(PROFILES / "lines" / "bench.toml").stations
    assert [station.family for station in stations] == ["dde", "dde", "ucr", "ale"]
    assert [station.ports or FAMILIES[station.family].ports for station in stations] == [
        (1, 2),
        (1, 2),
        (1,),
        (1,),
    ]
    assert stations[2].sim is not None
    assert stations[2].sim.model == "UCR245"


@pytest.mark.parametrize("name", ["dde", "nae", "hde", "ucr", "ale"])
def test_the_through_hole_recipe_fits_at_ten_hertz_on_two_ports(name: str) -> None:
    recipe, family = load_recipe(THT), FAMILIES[name]
    assert name in recipe.families
    two_ports = demand(recipe, family, family.ports or (1, 2), LineFormat())
    assert two_ports.fits(10, 0.001)
    assert two_ports.auto_rate_hz(0.001, 0.001) == (10 if family.ports == (1,) else 5)


@pytest.mark.parametrize("path", RECIPES, ids=lambda path: path.stem)
def test_no_recipe_demands_a_rate_that_a_slower_answer_could_refuse(path: Path) -> None:
    assert load_recipe(path).sampling.rate_hz == "auto"
