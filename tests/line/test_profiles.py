"""Every line file of the project, unchanged: planned, recorded, sealed, judged, and watched from
outside.

Each runs once, on virtual stations and a virtual clock. A new line file in `profiles/lines` is
tested like the others; one with another verdict than ACCEPT is listed in `OTHERWISE`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from support.command import PROFILES, RECIPE
from support.invoked import invoked
from support.product import (
    AUTO_RATES_HZ,
    COMMAND_OF,
    FAMILIES,
    FIRST_DURATION,
    RunOptions,
    RunPlan,
    StationSpec,
    check_run,
    fitting_recipe,
    load_line,
    make_plan,
    open_run,
    read_manifest,
    span_s,
)
from support.virtual.recorded_run import RecordedRun

LINES = sorted((PROFILES / "lines").glob("*.toml"))
SECONDS = 180.0  # long enough for a bound of every tip's idle error
# after a while its virtual feeder has no solder left
OTHERWISE = {"omega": "ACCEPT WITH DEVIATIONS"}
"""Line file -> verdict, if it is not ACCEPT."""

SETTINGS = {
    *("sleep_delay", "hibernation_delay", "sleep_temperature", "adjust", "selected_temperature"),
    *("alarm_high_limit", "alarm_high_delay", "alarm_low_limit", "alarm_low_delay"),
}
FEEDER = {
    "clog_detection",
    "feeder_diameter",
    "feeder_length",
    "feeder_backward",
    "feeder_speed",
    "feeder_mode",
}
AIR = {
    "selected_air_temperature",
    "selected_air_flow",
    "selected_external_temperature",
    "work_mode",
}
A_RUN_WRITES = SETTINGS | FEEDER | AIR | {"status", "stop_feeding"}
"""All settings that `run` can write (docs/reference/faults.md, S-5), except OMEGA's condition with
--allow-omega-write.
"""

every_line = pytest.mark.parametrize("path", LINES, ids=lambda path: path.stem)
Recorded = Callable[[Path], RecordedRun]


def plan_of(path: Path) -> RunPlan:
    """Return the plan of a line with its own recipes; a line without any gets the demo's."""
    own = all(station.recipe is not None for station in load_line(path).stations)
    return make_plan(RunOptions(path, None if own else RECIPE, duration_s=SECONDS))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """The run of a line file, recorded on first use."""
    return cache(lambda path: RecordedRun(plan_of(path), tmp_path_factory.mktemp(path.stem)))


@every_line
def test_its_plan_has_no_error(path: Path) -> None:
    plan = plan_of(path)
    arguments = [
        "plan",
        *([] if plan.wanted.recipe is None else [str(RECIPE)]),
        "--line",
        str(path),
    ]
    said = invoked(*arguments)
    assert said.exit_code == 0, said.output
    assert "error" not in said.output
    assert all(station.spec.name in said.output for station in plan.stations)


@every_line
def test_it_runs_to_an_accepted_record(path: Path, recorded: Recorded) -> None:
    result = recorded(path).result
    assert [one.outcome for one in result.manifest.stations] == ["completed"] * len(
        result.manifest.stations
    )
    assert result.manifest.verdict == OTHERWISE.get(path.stem, "ACCEPT"), [
        one.text for one in result.findings
    ]
    assert result.exit_code == (1 if path.stem in OTHERWISE else 0)
    assert check_run(result.folder) == []


@every_line
def test_what_sim_proposes_is_the_run_that_was_accepted(path: Path) -> None:
    assert span_s(FIRST_DURATION) == SECONDS
    if plan_of(path).wanted.recipe is not None:
        assert fitting_recipe(path, path) == RECIPE


@every_line
def test_its_manifest_says_which_rate_was_asked_for_and_which_was_taken(
    path: Path, recorded: Recorded
) -> None:
    for facts in read_manifest(recorded(path).result.folder).stations:
        assert facts.asked_rate == "auto"
        assert facts.rate_hz in AUTO_RATES_HZ
        assert facts.period_s == pytest.approx(1 / facts.rate_hz)


@every_line
def test_every_port_has_all_its_rows(path: Path, recorded: Recorded) -> None:
    result = recorded(path).result
    samples = open_run(result.folder).samples()
    for facts in result.manifest.stations:
        assert facts.ports
        assert facts.skipped == 0
        for port in facts.ports:
            rows = samples[(samples["station"] == facts.name) & (samples["port"] == port)]
            assert set(rows["quality"]) == {"ok"}
            assert facts.period_s is not None
            assert len(rows) == pytest.approx(SECONDS / facts.period_s, abs=1)


@every_line
def test_every_setting_of_its_recipes_holds(path: Path, recorded: Recorded) -> None:
    settings = open_run(recorded(path).result.folder).settings()
    assert set(settings["outcome"]) <= {"confirmed", "unchanged", "read", "unsupported"}
    for station in plan_of(path).stations:
        own = settings[settings["station"] == station.spec.name]
        assert set(own.loc[own["outcome"] == "unsupported", "setting"]) == set(station.skipped())


@every_line
def test_every_tool_is_safe_at_the_end(path: Path, recorded: Recorded) -> None:
    run = recorded(path)
    for facts in run.result.manifest.stations:
        family = FAMILIES[facts.family]
        if not family.safe_states:
            assert set(facts.safe_state.values()) <= {"not_available"}
            continue
        orders = run.stations[facts.name].log.written("status")
        for port in facts.touched:
            last = [order.value for order in orders if order.port == port][-1]
            assert last in [family.status.orders[name] for name in family.safe_states]
            assert facts.safe_state[port] == "verified"


def test_all_of_them_together_write_what_a_run_can_write_and_nothing_else(
    recorded: Recorded,
) -> None:
    written = {
        write.name
        for path in LINES
        for station in recorded(path).stations.values()
        for write in station.log.writes
    }
    assert written == A_RUN_WRITES


def test_no_recipe_reaches_another_command_or_a_dangerous_one() -> None:
    assert set(COMMAND_OF.values()) | {"status", "stop_feeding"} == A_RUN_WRITES
    commands = [
        family.commands[name]
        for family in FAMILIES.values()
        for name in A_RUN_WRITES
        if name in family.commands
    ]
    assert not any(command.dangerous for command in commands)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_has_a_line_with_a_recipe_of_its_own(family: str) -> None:
    stations = [
        station
        for path in LINES
        for station in load_line(path).stations
        if station.family == family
    ]
    assert any(station.recipe is not None for station in stations)


def test_the_systems_that_one_family_covers_have_a_line_each() -> None:
    """UCR245 and UCR470 (manual 004), ALE without and with perforation of the solder wire, two line
    formats of manual 000.
    """
    models = {
        station.sim.model
        for path in LINES
        for station in load_line(path).stations
        if station.sim is not None
    }
    assert {"UCR245", "UCR470", "DDR"} <= models
    assert {"ale", "ale-perforated", "soldering", "soldering-slow"} <= {path.stem for path in LINES}
    formats = {(station.baudrate, station.format, station.address) for station in _old()}
    assert formats == {(19200, "8E1", 1), (4800, "8O2", None)}


def _old() -> list[StationSpec]:
    return [
        station
        for path in LINES
        for station in load_line(path).stations
        if station.family == "soldering"
    ]
