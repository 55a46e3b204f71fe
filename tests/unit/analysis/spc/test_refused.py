"""A refusal tells its reason to whoever takes it for the result, and takes part in nothing else;
`control_chart` takes the resolution from a table of metrics.
"""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd
import pytest

from jbclog import spc
from jbclog.core.errors import UsageError

REASON = "There are 3 values; it takes at least 20."
STEP = 0.1


def unpacked(result: Any) -> object:
    x, moving_range = result
    return x, moving_range


@pytest.mark.parametrize(
    "use",
    [
        unpacked,
        lambda result: result[0],
        lambda result: list(result),
        lambda result: result.cpk,
        lambda result: result.lower,
    ],
)
def test_whoever_uses_it_as_the_result_is_told_why(use: Callable[[Any], object]) -> None:
    refused = spc.control_chart([1.0, 2.0, 3.0])
    assert isinstance(refused, spc.Refused)
    with pytest.raises(UsageError) as raised:
        use(refused)
    assert str(raised.value) == REASON


def test_it_is_a_plain_object_otherwise() -> None:
    refused = spc.Refused("too_few", REASON)
    assert refused
    assert not hasattr(refused, "cpk")
    assert copy.deepcopy(refused) == pickle.loads(pickle.dumps(refused)) == refused
    assert asdict(refused) == {"kind": "too_few", "text": REASON}
    assert repr(refused) == f"Refused(kind='too_few', text={REASON!r})"


def metrics(values: np.ndarray, **columns: object) -> pd.DataFrame:
    """Rows as `Runs.metrics` has them."""
    own = {"station": "dde-1", "port": 1, "metric": "recovery_s", "resolution": STEP}
    return pd.DataFrame({"value": values} | own | columns)


VALUES = 1.5 + np.random.default_rng(3).normal(0, 0.01, 40)
"""Their spread is far below the step, and no value shows that."""


def test_the_resolution_is_that_of_the_table() -> None:
    assert not isinstance(spc.control_chart(VALUES), spc.Refused)
    refused = spc.control_chart(metrics(VALUES))
    assert refused == spc.control_chart(VALUES, resolution=STEP)
    assert isinstance(refused, spc.Refused)
    assert refused.kind == "unresolved"
    assert not isinstance(spc.control_chart(metrics(VALUES), resolution=0.001), spc.Refused)


def test_a_run_without_the_value_has_no_say() -> None:
    fine = np.concatenate([VALUES[:25], np.full(40, np.nan)])
    steps = np.where(np.isnan(fine), STEP, 0.001)
    chart, _ = spc.control_chart(metrics(fine, resolution=steps))
    assert len(chart.points) == 25
    expected, _ = spc.control_chart(VALUES[:25], resolution=0.001)
    assert chart.upper == pytest.approx(expected.upper)


@pytest.mark.parametrize(
    ("columns", "names"),
    [
        ({"port": [1, 2] * 20}, "recovery_s of dde-1 port 1, recovery_s of dde-1 port 2"),
        ({"metric": ["recovery_s", "joints"] * 20}, "recovery_s of dde-1 port 1, joints of dde-1"),
    ],
)
def test_several_features_in_one_chart_are_refused(columns: dict[str, object], names: str) -> None:
    with pytest.raises(UsageError, match=f"one metric of one port; these rows have {names}"):
        spc.control_chart(metrics(VALUES, **columns))


def test_another_table_is_refused_with_the_columns_that_it_lacks() -> None:
    with pytest.raises(UsageError, match="this one lacks metric, resolution"):
        spc.control_chart(metrics(VALUES).drop(columns=["metric", "resolution"]))
