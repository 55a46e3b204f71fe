"""What a counter of plugged hours can be after some time."""

from __future__ import annotations

import pytest

from support.product import can_be


@pytest.mark.parametrize(
    ("hours", "before", "passed_h", "is_possible"),
    [
        (1200, 1200, 0.0, True),
        (1201, 1200, 0.0, True),  # the hour was nearly full
        (1202, 1200, 0.0, False),
        (1199, 1200, 1000.0, False),  # it never falls
        (1300, 1200, 100.0, True),
        (1302, 1200, 100.0, True),  # its clock is fast by one percent
        (1303, 1200, 100.0, False),
        (0, 99_999, 1.0, True),  # it rolls over
    ],
)
def test_a_counter_grows_no_faster_than_time(
    hours: int, before: int, passed_h: float, is_possible: bool
) -> None:
    assert can_be(hours, before, passed_h * 3600) is is_possible
