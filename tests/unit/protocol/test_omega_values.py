"""OMEGA's values: digits that stand for words, numbers of conditions, and the condition record.

No frame of these stands in a manual here: what is on the wire is put together by hand
(docs/reference/protocol.md, "Condition record"), and its sums are computed by the few lines below.
"""

from __future__ import annotations

from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.product import (
    OMEGA,
    TRUE_ANSWERS,
    WITHOUT_DIGIT,
    Cleaning,
    ConditionNumber,
    ConditionRecord,
    Digit,
    Omega,
    SetTemperature,
    StoredCondition,
    StoredRecord,
    condition_difference,
    differing_conditions,
    encode_omega,
    is_condition,
)

RECORD, NUMBER = StoredCondition(), ConditionNumber()
NUMBERS = st.sampled_from([number for number in range(400) if is_condition(number)])
TENTHS = st.integers(0, 4095).map(lambda raw: raw / 10)
CONDITIONS = st.builds(ConditionRecord, NUMBERS, st.integers(0, 4), *[TENTHS] * 15)
TEMPERATURES = st.builds(SetTemperature, NUMBERS, st.integers(0, 4095), st.integers(0, 4095))
STORED = st.one_of(CONDITIONS, TEMPERATURES, TENTHS.map(Cleaning))

COUNTED = ConditionRecord(124, 1, *[float(number) for number in range(1, 16)])
COUNTED_ON_WIRE = "007C100A01401E02803203C04605005A06406E07808208C096"
"""1.0 to 15.0 in the order of the record: ten is 00A, 150 is 096."""


def test_the_record_of_the_reference() -> None:
    """Four digits of number, one of mode, fifteen fields of three: 50 characters; a frame: 55."""
    assert RECORD.encode(COUNTED) == COUNTED_ON_WIRE
    assert RECORD.decode(COUNTED_ON_WIRE) == COUNTED
    assert len(COUNTED_ON_WIRE) == 50
    frame = encode_omega("c" + COUNTED_ON_WIRE)
    assert len(frame) == 55
    assert (
        frame
        == b"\x02c"
        + COUNTED_ON_WIRE.encode()
        + b"\x03"
        + f"{sum(b'c' + COUNTED_ON_WIRE.encode()) % 256:02X}".encode()
    )


def test_a_time_of_three_and_a_half_seconds() -> None:
    """ "3.5 s = 35 = 023" """
    assert RECORD.encode(ConditionRecord(101, 0, 3.5, *[0.0] * 14))[5:8] == "023"


def test_the_fields_are_those_of_a_recipe() -> None:
    assert [one.name for one in fields(ConditionRecord)] == list(Omega.model_fields)


def test_shorter_records() -> None:
    assert RECORD.encode(SetTemperature(399, 3500, 10)) == "018F5DAC00A"
    # raw: tenths or whole degrees, nothing decides (B-51)
    assert RECORD.decode("018F5DAC00A") == SetTemperature(399, 3500, 10)
    assert RECORD.encode(Cleaning(1.0)) == "000000A"
    # with a digit for its mode, and without
    assert RECORD.decode("000000A") == RECORD.decode("0000000A") == Cleaning(1.0)


@pytest.mark.parametrize(
    "data",
    [
        "",
        "007",
        "00641" + "000" * 15,  # 100
        "00C81" + "000" * 15,  # 200
        "01901" + "000" * 15,  # 400
        "00656" + "000" * 15,  # mode 6
        "00650" + "000" * 14,
        "00650" + "000" * 16,
        "00650" + "00G" * 15,
        "0065 " + "000" * 15,
        "00655" + "000" * 15,  # mode 5 has two fields
        "0000",
        "000000000",
    ],
)
def test_what_is_no_record(data: str) -> None:
    with pytest.raises(ValueError, match=r"number|mode|hexadecimal|fields|digits"):
        RECORD.decode(data)


@pytest.mark.parametrize(
    "value",
    [ConditionRecord(101, 0, 0.05, *[0.0] * 14), ConditionRecord(101, 0, 409.6, *[0.0] * 14)],
)
def test_what_three_digits_of_tenths_cannot_carry(value: StoredRecord) -> None:
    with pytest.raises(ValueError, match=r"step of 0\.1|409\.6 is not within 0 to 409\.5"):
        RECORD.encode(value)


@pytest.mark.parametrize(
    "value",
    [ConditionRecord(100, 0, *[0.0] * 15), ConditionRecord(101, 5, *[0.0] * 15), 101, "condition"],
)
def test_what_is_no_condition(value: object) -> None:
    with pytest.raises(ValueError, match=r"no number|known mode"):
        RECORD.encode(value)  # type: ignore[arg-type]  # that is the test


@given(STORED)
def test_a_record_comes_back_as_it_went(value: StoredRecord) -> None:
    text = RECORD.encode(value)
    assert RECORD.decode(text) == value
    assert RECORD.decode(text.lower()) == value
    assert text == text.upper()
    assert len(text) == {ConditionRecord: 50, SetTemperature: 11, Cleaning: 7}[type(value)]


@given(NUMBERS)
def test_numbers_are_hexadecimal(number: int) -> None:
    assert NUMBER.decode(NUMBER.encode(number)) == number
    assert int(NUMBER.encode(number), 16) == number


@pytest.mark.parametrize("number", [0, 100, 200, 300, 400, -1, 1])
def test_numbers_that_no_condition_has(number: int) -> None:
    with pytest.raises(ValueError, match="no number of a solder condition; 101 to 199"):
        NUMBER.encode(number)


def test_a_number_of_the_reference() -> None:
    """ "124 = 007C" """
    assert NUMBER.encode(124) == "007C"


def test_where_two_records_differ() -> None:
    other = RECORD.decode("007C0" + COUNTED_ON_WIRE[5:8] + "015" + COUNTED_ON_WIRE[11:])
    assert isinstance(other, StoredRecord)
    assert differing_conditions(COUNTED, other) == [("mode", "1", "0"), ("feed1_mm", "2.0", "2.1")]
    assert (
        condition_difference(COUNTED, other) == "mode 0 instead of 1, feed1_mm 2.1 instead of 2.0"
    )
    assert condition_difference(COUNTED, SetTemperature(124, 0, 0)) == "mode 5 instead of 1"
    assert differing_conditions(COUNTED, COUNTED) == []


def test_a_record_in_words() -> None:
    assert str(COUNTED).startswith(
        "condition 124: mode 1, rise_s 1.0, feed1_mm 2.0, feed1_mm_s 3.0"
    )
    assert [unit for _, unit, _ in COUNTED.values()][:4] == ["", "s", "mm", "mm/s"]


@pytest.mark.parametrize(
    "command", [one for one in OMEGA if isinstance(one.quantity, Digit)], ids=lambda one: one.name
)
def test_a_digit_is_one_word_of_its_command(command: object) -> None:
    quantity = command.quantity  # type: ignore[attr-defined]  # a command
    for number, name in enumerate(quantity.names):
        assert quantity.decode(str(number)) == name
        assert quantity.encode(name) == str(number)
    assert not quantity.may_lack or quantity.decode("") == WITHOUT_DIGIT
    for data in (*(() if quantity.may_lack else ("",)), "00", "-", str(len(quantity.names)), "²"):
        with pytest.raises(ValueError, match="no digit"):
            quantity.decode(data)
    with pytest.raises(ValueError, match="none of"):
        quantity.encode("nothing")


def test_what_the_digits_of_a_say() -> None:
    """0 normal, 1 solder shortage, 2 clogged, 3 both (003, 11.3.1; docs/reference/protocol.md)."""
    names = OMEGA[0].quantity.names  # type: ignore[attr-defined]  # digits
    assert [
        [name in TRUE_ANSWERS[column] for column in ("solder_shortage", "clogged")]
        for name in names
    ] == [
        [False, False],
        [True, False],
        [False, True],
        [True, True],
    ]
