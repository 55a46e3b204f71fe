"""What a recipe writes on a station, and in what order."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.config.load_recipe import SOLDERING, parse_recipe
from jbclog.config.recipe import COMMAND_OF
from jbclog.config.recipe_settings import (
    Setting,
    foreign_keys,
    live_problems,
    settings_for,
    station_settings_for,
)
from jbclog.core.quantities import OFF, Value
from jbclog.protocol.commands.command import Scope
from jbclog.protocol.commands.family import FAMILIES

RECIPE = """[recipe]
name = "job"
revision = 1
families = ["dde", "nae", "dme", "hde", "ucr", "ale", "soldering"]
[temperature]
select_c = 350
adjust_c = -5
[sleep]
temperature_c = 150
delay_min = 5
[hibernation]
delay_min = 30
[alarm.high]
limit_c = 380
delay_s = 1.6
[alarm.low]
limit_c = 300
delay_s = 2
[port.2.temperature]
select_c = 330
[feeder]
mode = "discontinuous"
length_mm = 5
speed_mm_s = 10.0
diameter_mm = 1.0
backward_mm = 1.0
clog_detection = true
"""
DDE, ALE, UCR = FAMILIES["dde"], FAMILIES["ale"], FAMILIES["ucr"]


def written(settings: list[Setting]) -> list[tuple[str, str]]:
    """Name and data field, as they go on the wire."""
    return [(one.command.name, one.command.quantity.encode(one.value)) for one in settings]


@pytest.mark.parametrize("family", SOLDERING)
def test_the_way_to_cool_comes_first_then_the_guard_and_heat_last(family: str) -> None:
    assert written(settings_for(parse_recipe(RECIPE), FAMILIES[family], 1)) == [
        ("sleep_delay", "00005"),
        ("hibernation_delay", "00030"),
        ("alarm_high_limit", "00380"),
        ("alarm_high_delay", "01.60"),
        ("alarm_low_limit", "00300"),
        ("alarm_low_delay", "02.00"),
        ("sleep_temperature", "00150"),
        ("adjust", "-0005"),
        ("selected_temperature", "00350"),
    ]


def test_an_alarm_that_is_switched_off_loses_its_delay_before_its_limit_moves() -> None:
    recipe = parse_recipe(RECIPE.replace("delay_s = 1.6", 'delay_s = "off"'))
    assert [
        name for name, _ in written(settings_for(recipe, DDE, 1)) if name.startswith("alarm")
    ] == [
        "alarm_high_delay",
        "alarm_high_limit",
        "alarm_low_limit",
        "alarm_low_delay",
    ]


def test_a_port_of_its_own_is_written_as_its_tables_say() -> None:
    recipe = parse_recipe(RECIPE)
    first, second = (settings_for(recipe, DDE, port)[-1] for port in (1, 2))
    assert (first.port, first.value, first.key) == (1, 350, "temperature.select_c")
    assert (second.port, second.value, second.key) == (2, 330, "port.2.temperature.select_c")


def test_a_value_is_the_one_that_the_station_will_give_back() -> None:
    recipe = parse_recipe(
        RECIPE.replace("delay_s = 1.6", "delay_s = 1.6000000001").replace(
            "delay_min = 5", "delay_min = 9"
        )
    )
    values = {one.command.name: one.value for one in settings_for(recipe, DDE, 1)}
    assert values["alarm_high_delay"] == 1.6
    assert values["sleep_delay"] == 9
    off = parse_recipe(RECIPE.replace("delay_s = 2", 'delay_s = "off"'))
    assert {one.command.name: one.value for one in settings_for(off, DDE, 1)}[
        "alarm_low_delay"
    ] is OFF


def test_only_what_the_recipe_names_is_written() -> None:
    recipe = parse_recipe(
        '[recipe]\nname = "j"\nrevision = 1\nfamilies = ["dde"]\n[sleep]\ndelay_min = 1\n'
    )
    assert written(settings_for(recipe, DDE, 2)) == [("sleep_delay", "00001")]
    assert station_settings_for(recipe, DDE) == []


def test_the_feeder_is_set_up_once_for_the_station_and_never_started() -> None:
    recipe = parse_recipe(RECIPE)
    settings = station_settings_for(recipe, ALE)
    assert written(settings) == [
        ("clog_detection", "00001"),
        ("feeder_diameter", "00100"),
        ("feeder_length", "00050"),
        ("feeder_backward", "00010"),
        ("feeder_speed", "00100"),
        ("feeder_mode", "00001"),
    ]
    assert {one.port for one in settings} == {None}
    assert not any(
        station_settings_for(recipe, family)
        for family in FAMILIES.values()
        if not family.has_feeder
    )


def test_every_key_of_the_order_is_a_setting_that_can_be_read_back_and_none_is_dangerous() -> None:
    commands = {
        name: command for family in FAMILIES.values() for name, command in family.commands.items()
    }
    for name in COMMAND_OF.values():
        assert commands[name].access == "rw"
        assert not commands[name].dangerous
        assert not commands[name].sent_once


def test_every_setting_of_a_port_or_tool_can_be_reached_from_a_recipe() -> None:
    settable = {
        name
        for name, command in DDE.commands.items()
        if command.access == "rw" and command.scope is not Scope.STATION
    } - {"status"}
    assert settable <= set(COMMAND_OF.values())


def test_what_is_foreign_to_a_station_is_named() -> None:
    recipe = parse_recipe(RECIPE)
    feeder = [
        "feeder_mode",
        "feeder_length",
        "feeder_speed",
        "feeder_diameter",
        "feeder_backward",
        "clog_detection",
    ]
    assert foreign_keys(recipe, DDE) == feeder
    assert foreign_keys(recipe, ALE) == ["port.2.temperature.select_c"]
    assert foreign_keys(recipe, UCR) == [*feeder, "port.2.temperature.select_c"]
    assert foreign_keys(recipe, FAMILIES["hde"]) == feeder
    assert foreign_keys(recipe, FAMILIES["hde"], ports=(1,)) == [
        *feeder,
        "port.2.temperature.select_c",
    ]


def test_sections_of_families_that_are_not_driven_are_foreign_by_their_key() -> None:
    recipe = parse_recipe(
        '[recipe]\nname = "j"\nrevision = 1\nfamilies = ["dde", "jtse"]\n[air]\ntemperature_c ='
        " 300\n"
    )
    assert foreign_keys(recipe, DDE) == ["selected_air_temperature"]


def test_what_only_the_station_knows_is_checked_against_its_own_limits() -> None:
    recipe = parse_recipe(RECIPE, Path("job.toml"))
    assert (
        live_problems(recipe, DDE, 1, {"maximum_temperature": 350, "minimum_temperature": 150})
        == []
    )
    assert live_problems(recipe, DDE, 1, {}) == [
        f"job.toml:{line}: {key}: {value} °C on port 1 cannot be checked: the station does not"
        " answer its maximum temperature"
        for line, key, value in ((9, "sleep.temperature_c", 150), (6, "temperature.select_c", 350))
    ]
    assert live_problems(
        recipe, DDE, 1, {"maximum_temperature": 345, "minimum_temperature": 90}
    ) == [
        "job.toml:6: temperature.select_c: 350 °C on port 1 is above the station's maximum of"
        " 345 °C"
    ]
    assert live_problems(
        recipe, DDE, 2, {"maximum_temperature": 450, "minimum_temperature": 335}
    ) == [
        (
            "job.toml:20: port.2.temperature.select_c: 330 °C on port 2 is below the station's"
            " minimum of 335 °C"
        ),
    ]


# -- hot air ---------------------------------------------------------------------------------------

AIR = """[recipe]
name = "air"
revision = 1
families = ["jtse"]

[air]
temperature_c = 320
flow_permille = 600
external_set_c = 180
mode = "profile"
"""
HELD: dict[str, Value] = {
    "maximum_air_flow": 120,
    "minimum_air_flow": 12,
    "maximum_air_temperature": 450,
    "minimum_air_temperature": 150,
    "maximum_external_temperature": 500,
    "minimum_external_temperature": 25,
}


def test_on_hot_air_mode_and_flow_come_before_heat() -> None:
    settings = settings_for(parse_recipe(AIR), FAMILIES["jtse"], 1)
    assert [(one.command.name, one.shown(), one.port, one.key) for one in settings] == [
        ("work_mode", "profile", 1, "air.mode"),
        ("selected_air_flow", "600 ‰ of the station's maximum air flow", 1, "air.flow_permille"),
        ("selected_external_temperature", "180 °C", 1, "air.external_set_c"),
        ("selected_air_temperature", "320 °C", 1, "air.temperature_c"),
    ]
    assert station_settings_for(parse_recipe(AIR), FAMILIES["jtse"]) == []


@pytest.mark.parametrize(
    ("permille", "greatest", "raw"),
    [(600, 1000, 600), (600, 100, 60), (333, 100, 33), (0, 50, 0), (1000, 45, 45)],
)
def test_a_share_is_counted_in_what_the_station_counts(
    permille: int, greatest: int, raw: int
) -> None:
    """raw = round(x * MAF / 1000) (docs/reference/configuration.md)."""
    recipe = parse_recipe(AIR.replace("600", str(permille)))
    flow = settings_for(recipe, FAMILIES["jtse"], 1)[1]
    counted = flow.as_counted({"maximum_air_flow": greatest})
    assert counted is not None
    assert (counted.value, counted.unit, counted.is_share) == (raw, "raw", False)
    assert flow.as_counted({}) is flow.as_counted({"maximum_air_flow": 0}) is None


def test_hot_air_is_held_against_what_the_station_allows() -> None:
    recipe = parse_recipe(AIR, Path("job.toml"))
    assert live_problems(recipe, FAMILIES["jtse"], 1, HELD) == []
    assert live_problems(
        recipe,
        FAMILIES["jtse"],
        1,
        HELD | {"minimum_air_flow": 100, "maximum_external_temperature": 175},
    ) == [
        (
            "job.toml:8: air.flow_permille: 600 ‰ of the station's maximum air flow on port 1, 72"
            " raw, is below the station's minimum of 100 raw"
        ),
        "job.toml:9: air.external_set_c: 180 °C on port 1 is above the station's maximum of 175 °C",
    ]


def test_a_recipe_for_both_says_of_each_what_it_has_not() -> None:
    recipe = parse_recipe(
        AIR.replace('"jtse"', '"jtse", "dde"')
        + "[temperature]\nselect_c = 350\n[port.1.sleep]\ndelay_min = 5\n[run]\n"
    )
    assert foreign_keys(recipe, DDE) == [
        "selected_air_temperature",
        "selected_air_flow",
        "selected_external_temperature",
        "work_mode",
    ]
    assert foreign_keys(recipe, FAMILIES["jtse"]) == [
        "selected_temperature",
        "port.1.sleep.delay_min",
    ]
    assert len(settings_for(recipe, FAMILIES["jtse"], 1)) == 4
    assert [one.command.name for one in settings_for(recipe, DDE, 1)] == [
        "sleep_delay",
        "selected_temperature",
    ]
