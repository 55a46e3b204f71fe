"""A value that a station's manual does not print is refused by the station itself (N 00003), not by
the limits of another manual.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from support.product import FAMILIES, Metadata, RunPlan, longest_countdown_s
from support.virtual.recorded_run import plan_in
from support.virtual.virtual_run import RECIPE, VirtualRun, prepare

LINE = """[line]
name = "old"

[[station]]
name = "s-1"
url = "s-1"
family = "{family}"
ports = [1]
[station.sim]
turnaround_ms = 1.0
{sim}
"""
OLD_JOB = (
    RECIPE.replace("select_c = 350", "select_c = 351\nadjust_c = 60")
    .replace("delay_min = 30", "delay_min = 62")
    .replace("delay_min = 5", "delay_min = 300\ntemperature_c = 81")
    .replace("limit_c = 380", "limit_c = 381")
    .replace('["soldering", "dde", "nae", "dme", "hde", "ucr", "ale"]', '["soldering"]')
)
"""Values that manual 002 does not allow, and that manual 000 does not print."""
SENT = ["WD1200300", "WH1200062", "WHA100381", "WS1200081", "WA1200060", "WST100351"]
STRICT = "refuses_unprinted = true"


def run_of(
    recipe: str, family: str = "soldering", sim: str = "", duration_s: float = 1.0
) -> VirtualRun:
    return prepare(LINE.format(family=family, sim=sim), recipe, duration_s=duration_s).go()


def test_an_older_station_is_set_to_what_it_takes_whatever_002_prints() -> None:
    run = run_of(OLD_JOB)
    assert run.facts.outcome == "completed"
    assert [one.text for one in run.writes if one.text in SENT] == SENT
    assert {row.outcome for row in run.memory.settings if row.requested} == {"confirmed"}


def test_an_older_station_with_the_limits_of_002_refuses_and_its_number_is_recorded() -> None:
    run = run_of(OLD_JOB, sim=STRICT)
    assert run.facts.outcome == "refused"
    assert (
        "sleep delay of port 1: requested 300 min, but the station refused it with N 00003"
        in run.facts.reason
    )
    assert [(row.setting, row.nak) for row in run.memory.settings if row.outcome == "refused"] == [
        ("sleep_delay", 3)
    ]
    assert not [one for one in run.writes if one.text.startswith("WST")]


def test_a_countdown_longer_than_002_allows_is_a_value_on_an_older_station() -> None:
    run = run_of(OLD_JOB.replace('status = "working"', 'status = "stand"'), duration_s=12.0)
    counted = [value for value in run.memory.column("delay_s") if value is not None]
    assert counted
    assert all(isinstance(value, int) and 17_900 < value <= 18_000 for value in counted)
    assert longest_countdown_s(FAMILIES["dde"]) == 3600


@pytest.mark.parametrize("family", ["soldering", "dde", "ucr"])
def test_a_sleep_temperature_below_the_minimum_of_the_setting_is_the_station_s_to_refuse(
    family: str,
) -> None:
    recipe = RECIPE.replace("delay_min = 5", "delay_min = 5\ntemperature_c = 80")
    run = run_of(recipe, family)
    assert run.facts.outcome == "completed"
    assert [
        row.outcome
        for row in run.memory.settings
        if row.setting == "sleep_temperature" and row.requested
    ] == ["confirmed"]
    refused = run_of(recipe, family, STRICT)
    assert "requested 80 °C, but the station refused it with N 00003" in refused.facts.reason


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "select_c = 350",
            "select_c = 400",
            "400 °C on port 1 is above the station's maximum of 380 °C",
        ),
        (
            "delay_min = 5",
            "delay_min = 5\ntemperature_c = 390",
            "390 °C on port 1 is above the station's maximum of 380 °C",
        ),
        (
            "select_c = 350",
            "select_c = 5000",
            "5000 °C on port 1 is above the station's maximum of 380 °C",
        ),
    ],
)
@pytest.mark.parametrize("family", ["soldering", "dde"])
def test_a_temperature_above_the_station_s_own_maximum_is_refused_before_the_first_write(
    family: str, old: str, new: str, told: str
) -> None:
    recipe = RECIPE.replace("limit_c = 380\ndelay_s = 0.5", 'delay_s = "off"').replace(old, new)
    if "temperature_c" in new:
        recipe = recipe.replace("[temperature]\nselect_c = 350\n", "")
    run = run_of(recipe, family, "settings = {maximum_temperature = 380}")
    assert run.facts.outcome == "refused"
    assert told in run.facts.reason
    assert run.writes == []


def test_without_the_station_s_own_maximum_no_temperature_is_written() -> None:
    fault = '\n[[station.sim.fault]]\nkind = "nak"\ncode = 4\ncommand = "maximum_temperature"\n'
    run = run_of(RECIPE, "dde", fault)
    assert "the station does not answer its maximum temperature" in run.facts.reason
    assert run.writes == []


# -- the plan --------------------------------------------------------------------------------------


def plan_of(folder: Path, recipe: str, family: str) -> RunPlan:
    return plan_in(folder, LINE.format(family=family, sim=""), recipe, 5.0, metadata=Metadata())


def test_a_plan_notes_what_is_beyond_another_manual_s_limits(tmp_path: Path) -> None:
    notes = plan_of(tmp_path, OLD_JOB, "soldering").notes
    beyond = "so it is sent, and the station accepts it or refuses it with N 00003"
    assert (
        "s-1: sleep.delay_min: 300 min is not within 0 to 9 min, in steps of 1 (002 W-Dxy). Manual"
        f" 000 prints no such limit of sleep_delay, {beyond}" in notes
    )
    assert (
        "s-1: sleep.delay_min: manual 000 prints no unit of sleep_delay; min is taken from 002"
        " W-Dxy" in notes
    )
    keys = {note.split(": ")[1] for note in notes if note.endswith(beyond)}
    assert keys == {
        *(
            "sleep.delay_min",
            "hibernation.delay_min",
            "sleep.temperature_c",
            "temperature.select_c",
        ),
        *("temperature.adjust_c", "alarm.high.limit_c"),
    }


def test_a_plan_notes_nothing_where_all_is_within_what_is_printed(tmp_path: Path) -> None:
    assert plan_of(tmp_path, RECIPE, "dde").notes == []


def test_a_plan_notes_a_feed_that_takes_very_long_and_does_not_refuse_it(tmp_path: Path) -> None:
    recipe = f"{RECIPE}\n[feeder]\nlength_mm = 5000\nspeed_mm_s = 0.1\n"
    told = (
        "s-1: feeder.length_mm: one feed takes 50000 s at 0.1 mm/s; is the decimal point where it"
        " belongs?"
    )
    assert plan_of(tmp_path, recipe, "ale").notes == [told]
    assert plan_of(tmp_path, recipe, "dde").notes == []


def test_what_002_prints_stays_refused_on_its_stations(tmp_path: Path) -> None:
    from support.product import Problems

    with pytest.raises(Problems) as told:
        plan_of(tmp_path, OLD_JOB.replace('["soldering"]', '["soldering", "dde"]'), "soldering")
    assert len(told.value.problems) == 6
