"""The bound of a 95 % quantile, against Wilks's published sample sizes and against what chance
really does.
"""

from __future__ import annotations

import numpy as np
import pytest

from jbclog.analysis.verdict.quantiles import effective_size, most_above, upper_p95

WILKS = (59, 93, 124, 153, 181, 208, 234, 260, 286, 311)
"""Sample sizes for 95 % / 95 %, the greatest, the second, ... the tenth value being the bound: the
tables of safety analysis.
"""


@pytest.mark.parametrize(("above", "n"), [*enumerate(WILKS)])
def test_the_sample_sizes_are_those_of_the_table(above: int, n: int) -> None:
    assert most_above(n) == above
    assert most_above(n - 1) == above - 1


@pytest.mark.parametrize("n", [59, 150, 700])
def test_it_holds_as_often_as_it_says(n: int) -> None:
    rng = np.random.default_rng(n)
    truth = float(np.exp(1.6448536))
    bounds = [upper_p95([*np.exp(rng.standard_normal(n))]) for _ in range(1000)]
    held = [bound.high >= truth for bound in bounds if not isinstance(bound, str)]
    assert len(held) > 920  # one in twenty series looks as if neighbours were alike
    assert sum(held) > 0.93 * len(held)  # 95 %, less three standard deviations


def test_few_joints_give_no_bound_and_a_sentence() -> None:
    assert upper_p95([1.0] * 58) == "A 95 % bound takes 59 joints; there are 58."
    bound = upper_p95([1.0, *[0.5] * 58])
    assert not isinstance(bound, str)
    assert (bound.low, bound.high, bound.n, bound.n_effective) == (None, 1.0, 59, 59)


def test_joints_that_are_alike_are_worth_fewer() -> None:
    rng, course = np.random.default_rng(3), [0.0]
    for _ in range(999):
        course.append(0.8 * course[-1] + rng.standard_normal())
    assert effective_size(rng.standard_normal(1000)) > 850
    assert effective_size(np.array(course)) == pytest.approx(1000 * 0.2 / 1.8, rel=0.4)
    refused = upper_p95(course[:200])
    assert isinstance(refused, str)
    assert refused.startswith("A 95 % bound takes 59 joints; there are 200, worth ")


def test_a_recovery_that_is_not_known_counts_as_the_longest() -> None:
    known = [float(value) for value in np.random.default_rng(5).permutation(93)]
    whole, lacking = upper_p95(known), upper_p95([None if value == 0 else value for value in known])
    assert not isinstance(whole, str)
    assert not isinstance(lacking, str)
    assert (whole.high, lacking.high) == (91, 92)
    text = upper_p95([None if value < 2 else value for value in known])
    assert (
        text == "The recovery of 2 of them is not known and may be longer; a 95 % bound allows 1."
    )
