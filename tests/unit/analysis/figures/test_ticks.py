"""Times on the page: round, in UTC, few enough to be read."""

from __future__ import annotations

from itertools import pairwise

import pytest

from jbclog.analysis.figures.ticks import duration_text, time_marks

NOON = 1_790_164_800_000_000  # 2026-09-23 12:00 UTC


def test_marks_lie_on_round_times_of_the_clock() -> None:
    marks = time_marks(NOON + 7_000_000, 0, 20, 9)
    assert [label for _, label in marks] == ["12:00:10", "12:00:15", "12:00:20", "12:00:25"]
    assert [place for place, _ in marks] == pytest.approx([3, 8, 13, 18])


@pytest.mark.parametrize(
    "seconds", [0.1, 1, 7, 20, 59, 61, 600, 3599, 8 * 3600, 25 * 3600, 8 * 86400, 60 * 86400]
)
@pytest.mark.parametrize("at_most", [5, 9])
def test_there_are_never_too_many(seconds: float, at_most: int) -> None:
    marks = time_marks(NOON + 123_456, -3.0, seconds - 3, at_most)
    assert len(marks) <= at_most
    assert all(-3 - 1e-6 <= place <= seconds - 3 + 1e-6 for place, _ in marks)
    assert all(one != other for (_, one), (_, other) in pairwise(marks))


def test_a_run_of_days_names_the_day() -> None:
    hours = [label for _, label in time_marks(NOON, 0, 86400, 9)]
    assert hours == [
        "12:00",
        "15:00",
        "18:00",
        "21:00",
        "09-24",
        "03:00",
        "06:00",
        "09:00",
        "12:00",
    ]
    assert time_marks(NOON, 0, 5 * 86400, 9)[0][1] == "09-24"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.04, "0.0 s"),
        (20, "20.0 s"),
        (59.96, "1 min"),
        (125, "2 min 5 s"),
        (28778, "7 h 59 min 38 s"),
        (3600, "1 h"),
        (86400, "24 h"),
    ],
)
def test_durations(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text
