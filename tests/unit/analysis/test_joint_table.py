"""What is done for a whole column of joints is what is done for each."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from jbclog.analysis.joints import levels
from jbclog.analysis.run_metrics import rounded

NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(-1e6, 1e6),
    st.integers(-(10**9), 10**9).map(lambda number: number / 2000),  # halves of the last decimal
)


@given(st.lists(NUMBERS, max_size=20), st.sampled_from([3, 6]))
@example([1.797693134862316e305], 3)
def test_a_column_is_rounded_as_each_number(numbers: list[float], decimals: int) -> None:
    found = rounded(np.array(numbers, dtype=np.float64), decimals)
    assert [*map(repr, found.tolist())] == [repr(round(one, decimals)) for one in numbers]


@pytest.mark.parametrize("odd", [350.0, -20.0, 1e12])
def test_temperatures_are_counted_as_they_are_rounded(odd: float) -> None:
    some = np.append(np.random.default_rng(1).normal(350, 2, 5000), odd)
    values, counts = np.unique(some.round(levels.DECIMALS), return_counts=True)
    assert levels._counted(some) == dict(zip(values.tolist(), counts.tolist(), strict=True))
