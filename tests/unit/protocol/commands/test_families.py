"""What is a family's own beside its commands (`test_every_command.py`): models, signals, counters,
states, numbers and words.
"""

from __future__ import annotations

import re

import pytest

from support.campaigns.each_row import each_row
from support.product import (
    AIR_STATUS,
    COMMUNICATION_ERRORS,
    FAMILIES,
    SIGNAL_COLUMNS,
    SIGNAL_OF_COLUMN,
    SOLDERING_STATUS,
    Effect,
    Family,
    ReadInterval,
    family_of,
)

families = each_row((family.name, (family,)) for family in FAMILIES.values())


@families
def test_signals_fill_columns_from_readable_commands(family: Family) -> None:
    columns = [column for signal in family.signals for column in signal.columns]
    assert len(columns) == len(set(columns))
    for signal in family.signals:
        assert family.commands[signal.command].readable
        assert set(signal.columns) <= set(SIGNAL_COLUMNS)
        assert {SIGNAL_OF_COLUMN[column] for column in signal.columns} == {signal.name}
        assert signal.interval is not ReadInterval.COUNTERS
    fast = [
        "temperature_c",
        "power_permille",
        "status",
        *(["external_c"] if family.name == "jtse" else []),
    ]
    if family.name == "omega":  # it tells its states and no temperature
        fast = ["solder_shortage", "preparing", "in_range"]
    assert [
        signal.name for signal in family.signals if signal.interval is ReadInterval.FAST
    ] == fast


@families
def test_counters_are_readable_commands_in_their_unit(family: Family) -> None:
    for counter in family.counters:
        command = family.commands[counter.command]
        assert command.access == "r"
        assert command.unit == counter.unit
    assert len({counter.name for counter in family.counters}) == len(family.counters)
    often = {
        counter.name for counter in family.counters if counter.interval is not ReadInterval.COUNTERS
    }
    # each feed is evidence of a joint
    assert often == ({"dispensed_cycles"} if family.has_feeder else set())


@families
def test_safe_states_and_run_statuses_are_orders_that_the_station_takes(family: Family) -> None:
    """docs/reference/safe-states.md."""
    assert family.safe_states[:1] == {"jtse": ("cooling",), "omega": ()}.get(
        family.name, ("stand",)
    )
    for name in (*family.safe_states, *family.run_statuses):
        word = family.status.orders[name]
        assert (
            family.commands["status"].quantity.decode(
                family.commands["status"].quantity.encode(word)
            )
            == word
        )
    assert not any(
        family.status.is_working(family.status.orders[name]) for name in family.safe_states
    )


@families
def test_only_stations_with_a_feeder_feed(family: Family) -> None:
    moving = [
        command.name for command in family.commands.values() if command.effect is Effect.MOVES
    ]
    orders = ["store_condition", "run_condition"] if family.name == "omega" else []
    assert moving == (["start_feeding"] if family.has_feeder else orders)
    assert (
        family.has_feeder
        == ("stop_feeding" in family.commands)
        == any(signal.name == "feeding" for signal in family.signals)
    )


@families
def test_a_model_name_proves_its_own_family_and_no_other(family: Family) -> None:
    for model in family.models:
        assert family_of(model) is family
        assert family_of(model.lower() + "-2C") is family
        assert family.proves(model)


@pytest.mark.parametrize(
    ("model", "name"),
    [
        ("UCR245", "ucr"),
        ("UCR470", "ucr"),
        # what five characters leave of it (docs/reference/contradictions.md, B-34)
        ("UCR24", "ucr"),
        ("ALE", "ale"),
        ("NAE", "nae"),
        ("DDE", "dde"),
        ("DME", "dme"),
        ("HDE", "hde"),
        ("DDR", "soldering"),
        ("JTSE", "jtse"),
        ("", None),
        ("SDE", None),
        ("xDDE", None),
    ],
)
def test_the_models_that_the_manuals_name(model: str, name: str | None) -> None:
    found = family_of(model)
    assert (found.name if found else None) == name


@families
def test_numbers_that_no_table_has_are_kept(family: Family) -> None:
    assert family.tool_name(42) == "tool_42"
    assert re.fullmatch(r"unknown (port|OMEGA) error 42", family.port_errors.text(42))
    assert re.fullmatch(r"unknown (station|OMEGA) error 42", family.station_errors.text(42))


def test_words_of_status_and_errors() -> None:
    assert SOLDERING_STATUS.names == ("working", "stand", "sleep", "hibernation")
    assert SOLDERING_STATUS.orders == {
        "working": (0, 0, 0, 0, 0),
        "stand": (0, 0, 0, 0, 1),
        "extractor": (0, 0, 0, 1, 0),
    }
    # manual 001, 4.6
    assert AIR_STATUS.orders == {
        "on": (0, 0, 0, 0, 1),
        "off": (0, 0, 0, 0, 0),
        "cooling": (0, 0, 0, 1, 0),
    }
    assert sorted(COMMUNICATION_ERRORS) == [1, 2, 3, 4, 5, 6, 255, 99999]


@pytest.mark.parametrize(
    ("word", "works", "rests"),
    [
        ((0, 0, 0, 0, 0), True, False),
        ((0, 0, 0, 0, 1), False, True),
        ((0, 0, 0, 0, 2), False, True),
        ((0, 0, 0, 0, 3), False, True),
        # in the extractor: neither at work nor in a state that proves that it cools
        ((0, 0, 0, 1, 0), False, False),
        ((0, 0, 0, 1, 1), False, False),
    ],
)
def test_a_tool_in_the_extractor_state_neither_works_nor_rests(
    word: tuple[int, ...], works: bool, rests: bool
) -> None:
    assert (SOLDERING_STATUS.is_working(word), SOLDERING_STATUS.is_resting(word)) == (works, rests)


@pytest.mark.parametrize(
    ("ordered", "found", "safe"),
    [
        ("stand", (0, 0, 0, 0, 2), True),  # asleep by now
        ("stand", (0, 0, 0, 0, 0), False),
        ("extractor", (0, 0, 0, 1, 0), True),
        ("extractor", (0, 0, 0, 0, 0), False),
        ("extractor", (0, 0, 0, 0, 1), True),  # from which it cools by itself
    ],
)
def test_a_safe_state_is_reached_where_the_station_says_so(
    ordered: str, found: tuple[int, ...], safe: bool
) -> None:
    assert SOLDERING_STATUS.is_safe(found, SOLDERING_STATUS.orders[ordered]) == safe


@pytest.mark.parametrize(
    "model", ["UCR\x1b[31m", "UCRx1b[31m", "UCR;", "=UCR245", "DDE<b>", "JT\n", " UCR245", ""]
)
def test_a_name_with_odd_characters_proves_no_family(model: str) -> None:
    assert family_of(model) is None
    assert [
        family.name for family in FAMILIES.values() if family.models and family.proves(model)
    ] == []
