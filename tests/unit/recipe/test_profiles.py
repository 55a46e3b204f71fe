"""The lines and recipes that come with the project: they load, cover every family, and fit their wires."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.commands.family import FAMILIES, Family
from jbclog.recipe.line import StationSpec, load_line
from jbclog.recipe.load import load_recipe
from jbclog.recipe.model import Recipe
from jbclog.recipe.settings import condition_of, settings_for
from jbclog.scheduler import Demand, readings_of
from jbclog.wire import LineFormat

PROFILES = Path(__file__).parents[3] / "profiles"
LINES = sorted((PROFILES / "lines").glob("*.toml"))
RECIPES = sorted((PROFILES / "recipes").glob("*.toml"))
THT = PROFILES / "recipes" / "sn100c-tht.toml"


def demand(recipe: Recipe, family: Family, ports: tuple[int, ...], line: LineFormat) -> Demand:
    signals = [(signal, family.commands[signal.command]) for signal in family.signals]
    counters = [(counter, family.commands[counter.command]) for counter in family.counters]
    sampling = recipe.sampling
    return Demand.of(readings_of(signals, counters, ports, line, True, sampling.alarms_every_s, sampling.counters_every_s))


def fits(recipe: Recipe, station: StationSpec) -> bool:
    family = FAMILIES[station.family]
    ports = station.ports or family.ports
    assert ports is not None, f"{station.name} does not say which ports it has"
    return demand(recipe, family, ports, station.line_format).fits(recipe.rate_hz(family), 0.001)


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
        assert not FAMILIES[station.family].models or FAMILIES[station.family].proves(station.sim.model or station.family)
        recipe = load_recipe(station.recipe or THT)
        assert station.family in recipe.families
        assert fits(recipe, station)


def test_every_family_has_a_line_and_a_recipe() -> None:
    assert {path.stem for path in LINES} >= {*FAMILIES, "bench"}
    assert {path.stem.partition("-")[0].rstrip("0123456789") for path in LINES} == {*FAMILIES, "bench"}
    assert {family for path in RECIPES for family in load_recipe(path).families} == set(FAMILIES)


def test_the_bench_is_the_one_that_the_demo_shows() -> None:
    stations = load_line(PROFILES / "lines" / "bench.toml").stations
    assert [station.family for station in stations] == ["dde", "dde", "ucr", "ale"]
    assert [station.ports or FAMILIES[station.family].ports for station in stations] == [(1, 2), (1, 2), (1,), (1,)]
    assert stations[2].sim is not None
    assert stations[2].sim.model == "UCR245"


@pytest.mark.parametrize("name", ["dde", "nae", "hde", "ucr", "ale"])
def test_the_through_hole_recipe_fits_at_ten_hertz_on_two_ports(name: str) -> None:
    recipe, family = load_recipe(THT), FAMILIES[name]
    assert name in recipe.families
    assert recipe.sampling.rate_hz == 10
    assert demand(recipe, family, family.ports or (1, 2), LineFormat()).fits(10, 0.001)


def test_four_ports_cannot_have_what_two_can() -> None:
    dme = load_line(PROFILES / "lines" / "dme.toml").stations[0]
    assert not fits(load_recipe(THT), dme)
    assert dme.recipe is not None
    assert load_recipe(dme.recipe).sampling.rate_hz == 2
