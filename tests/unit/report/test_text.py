"""Text from outside and numbers on the page."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from jbclog.core.clock import utc_text
from jbclog.core.text import clean, cleaned, number, stamp, together
from jbclog.report.text import clock, measured


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain", "plain"),
        ("Lötspitze 350 °C", "Lötspitze 350 °C"),
        ("red\x1b[31m", "red\ufffd[31m"),
        ("a\x00b\x7fc\x9bd", "a\ufffdb\ufffdc\ufffdd"),
        ("two\nlines\tand", "two lines and"),
        ("evil\u202etxt.exe\u2066", "evil\ufffdtxt.exe\ufffd"),
        ("hid\u200bden\ufeff", "hid\ufffdden\ufffd"),
        ("half \ud800 surrogate", "half \ufffd surrogate"),
    ],
)
def test_control_and_formatting_characters_do_nothing_and_show_that_they_were_there(
    text: str, shown: str
) -> None:
    assert clean(text) == shown
    assert clean(text).encode()


def test_everything_inside_is_cleaned_keys_as_well() -> None:
    assert cleaned({"a\x1b": ["b\x00", ("c\u202e", 1, None, True)]}) == {
        "a\ufffd": ["b\ufffd", ["c\ufffd", 1, None, True]]
    }


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [
        (None, 2, "–"),
        (0, 2, "0"),
        (0.0, 2, "0"),
        (-0.001, 2, "0"),
        (-3, 2, "\u22123"),
        (1234567, 2, "1\u202f234\u202f567"),
        (100.0, 0, "100"),
        (99.5, 2, "99.5"),
        (99.999, 2, "100"),
        ("00001", 2, "00001"),
        (True, 2, "True"),
    ],
)
def test_numbers(value: object, digits: int, shown: str) -> None:
    assert number(value, digits) == shown


def test_times() -> None:
    text = utc_text(datetime(2026, 11, 21, 1, 30, 0, 123456, tzinfo=UTC))
    assert text == "2026-11-21T01:30:00.123456Z"
    assert stamp(text) == "2026-11-21 01:30:00"
    assert clock(text) == "01:30:00.123"
    assert clock(text, with_day=True) == "11-21 01:30:00.123"
    assert stamp(None) == "not known"
    assert clock(None) == ""


def test_a_number_keeps_its_unit_beside_it() -> None:
    assert (
        together("99.5 % in 5 s, 15 °C; 3 stations")
        == "99.5\u00a0% in 5\u00a0s, 15\u00a0°C; 3 stations"
    )


def test_per_cent_are_never_rounded_up() -> None:
    assert measured(99.9999, "%") == "99.99 %"
    assert measured(100.0, "%") == "100 %"
    assert measured(1.999, "s") == "2 s"
    assert measured("whole", "") == "whole"
    assert measured(None, "%") == "–"
