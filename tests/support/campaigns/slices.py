"""A slice of a campaign's trials that runs by default; the others run with the campaign
(`pytest -m campaign FILE`).
"""

from __future__ import annotations

import pytest


def first(count: int, of: range) -> list[object]:
    """`count` of the trials by default."""
    return [
        *of[:count],
        *(pytest.param(number, marks=pytest.mark.campaign) for number in of[count:]),
    ]
