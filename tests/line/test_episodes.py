"""Alarm episodes of virtual stations: the recorded rows give the same alarms as the session found,
whatever the link does.
"""

from __future__ import annotations

import pytest

from support.product import COLUMN, Detector, EventRow, evaluated_alarms, flag_episodes
from support.virtual.lines import fault
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

GOES_ON = RECIPE + 'on_difference = "continue"\n'


def run_with(sim: str, recipe: str = GOES_ON, duration_s: float = 40) -> VirtualRun:
    return prepare(
        line_text("joints_per_minute = 0\n" + sim, "ports = [1]"), recipe, duration_s=duration_s
    )


def evaluated(run: VirtualRun) -> tuple[list[EventRow], list[bool]]:
    """Return the alarm events that the recorder's evaluation gives for a run, and of each tool
    whether it came to its setting: settings first, then events, then rows.
    """
    memory = run.memory
    return evaluated_alarms(run.facts, memory.settings, memory.events, memory.samples)


@pytest.mark.parametrize(
    "sim",
    [
        "",
        fault("overheat", at_s=12, for_s=6, by_c=20),
        fault("overheat", by_c=60.0),
        fault("tool", at_s=6.0, for_s=7.0, code=0)
        + fault("overheat", at_s=10.0, for_s=30.0, by_c=60.0),
        fault("dropout", at_s=12, for_s=5),
        "settings = {status = 'working'}",
    ],
    ids=["calm", "hot", "runs away", "pulled", "dropout", "at work before"],
)
def test_the_rows_say_when_a_tool_came_to_its_setting_as_the_session_saw_it(sim: str) -> None:
    run = run_with(sim).go()
    _, (has_arrived,) = evaluated(run)
    assert has_arrived is run.contexts["dde-1"].ports[1].at_temperature


def kinds(run: VirtualRun) -> list[str]:
    return [event.kind.removeprefix("alarm.episode.") for event in evaluated(run)[0]]


def test_heating_up_raises_nothing() -> None:
    assert kinds(run_with("").go()) == []


def test_what_is_too_hot_for_longer_than_the_delay_is_raised_and_clears() -> None:
    run = run_with(fault("overheat", at_s=12, for_s=6, by_c=20)).go()
    assert kinds(run) == ["raised", "cleared"]
    (flag,) = flag_episodes([event for event in run.memory.events if event.port == 1])
    raised, cleared = evaluated(run)[0]
    assert flag.onset_earliest_us <= raised.time <= flag.onset_us + 200_000
    assert flag.detector is Detector.STATION
    assert cleared.earliest is not None
    assert flag.end_us is not None
    assert cleared.earliest <= flag.end_us


def test_an_outage_neither_raises_nor_clears() -> None:
    """The tip is hot before and after the outage."""
    run = run_with(
        fault("overheat", at_s=12, for_s=20, by_c=25) + fault("dropout", at_s=18, for_s=6),
        duration_s=50,
    ).go()
    assert kinds(run) == ["raised", "cleared"]
    assert any(row[COLUMN["quality"]] == "disconnected" for row in run.memory.samples)


def test_a_long_outage_leaves_it_uncertain() -> None:
    sim = fault("overheat", at_s=12, for_s=100, by_c=25) + fault("dropout", at_s=18, for_s=80)
    assert kinds(run_with(sim, duration_s=120).go()) == ["raised", "uncertain", "cleared"]


def test_a_limit_found_changed_holds_for_what_follows() -> None:
    run = run_with(
        "", RECIPE + 'on_difference = "continue"\n[sampling]\ncounters_every_s = 5\n', duration_s=40
    )
    run.at(15, lambda: setattr(run.station.plant.ports[1].settings, "alarm_high_limit", 340))
    assert kinds(run.go()) == ["raised"]
    assert evaluated(run)[0][0].limit_value == 340
