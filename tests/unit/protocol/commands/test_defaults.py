"""Factory settings: the manuals' tables typed a second time, and virtual stations that begin with
the product's.
"""

from __future__ import annotations

import pytest

from support.clients.converse import Pair
from support.product import FAMILIES, MODELS, OFF, Default, Family, default_values

families = pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)

PRINTED = {  # 002 "Factory Settings for Control Box", 004 "Factory Settings"
    "selected_temperature": "350 °C",
    "status": "Extract (stand by)",
    "adjust": "0 °C",
    "sleep_temperature": "150 °C",
    "sleep_delay": "10 sec. (general), 0 sec. (tool)",
    "hibernation_delay": "10 sec.",
    "alarm_high_limit": "not set",
    "alarm_low_limit": "not set",
    "maximum_temperature": "500 °C",
    "minimum_temperature": "90 °C",
}


@pytest.mark.parametrize("name", ["dde", "nae", "dme", "hde", "ucr", "ale"])
def test_what_is_printed_is_in_the_table(name: str) -> None:
    assert {
        one.command: one.printed for one in FAMILIES[name].defaults if one.printed and not one.model
    } == PRINTED


def test_the_older_manual_and_that_of_hot_air_print_none() -> None:
    assert not any(
        one.printed or one.manual
        for name in ("soldering", "jtse")
        for one in FAMILIES[name].defaults
    )


@pytest.mark.parametrize(
    ("name", "model", "celsius"),
    [
        ("ucr", "UCR245", 450),
        ("ucr", "UCR470", 500),
        ("dde", "DDE", 500),
        ("ale", "ALE", 500),
        ("soldering", "DDR", 500),
    ],
)
def test_the_highest_temperature_goes_by_the_model(name: str, model: str, celsius: int) -> None:
    """004: "UCR245 - 450°C, UCR470 - 500°C"; 002 prints 500 for all of its stations
    (docs/reference/contradictions.md, B-31).
    """
    assert default_values(FAMILIES[name].defaults, model)["maximum_temperature"] == celsius
    pair = Pair(name, sim=f'model = "{model}"')
    assert pair.read(pair.family.commands["maximum_temperature"]) == celsius


@families
def test_a_default_is_one_of_the_familys_settings_and_says_where_it_is_from(family: Family) -> None:
    assert len({(one.command, one.model) for one in family.defaults}) == len(family.defaults)
    for one in family.defaults:
        command = family.commands[one.command]
        assert command.access == "rw"
        assert bool(one.printed) == bool(one.manual)
        assert (
            one.value is OFF or one.command == "status" or command.limits.problem(one.value) is None
        )


@families
def test_a_virtual_station_begins_with_them(family: Family) -> None:
    pair = Pair(family.name)
    for one in _in_force(family):
        for place in pair.places(family.commands[one.command]):
            assert pair.read(*place) == one.value, one.command


def _in_force(family: Family) -> list[Default]:
    """What holds for the model that a virtual station of this family tells, where the file names
    none.
    """
    values = default_values(family.defaults, MODELS.get(family.name, family.name))
    return [one for one in family.defaults if one.value == values[one.command]]
