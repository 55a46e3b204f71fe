"""The thermal model of a tip of the simulator, whose heat capacity is known, where the record
begins hot.
"""

from __future__ import annotations

import pytest

from jbclog.analysis.joints.joints import find_joints
from support.plants import joint_matrix
from support.plants.joint_matrix import Cell, script_of, series_of


@pytest.mark.parametrize(
    ("tip", "capacity"), [("small", 1000 * 0.45 / 75), ("large", 1000 * 3.5 / 250)]
)
def test_the_capacity_of_a_tip_is_found_where_the_record_begins_hot(
    tip: str, capacity: float
) -> None:
    """No heat-up is in it: what is left are the few kelvin of each recovery. A capacity that is not
    the usual one of 10 ‰·s/K is drawn to it.
    """
    cells = [
        cell
        for cell in joint_matrix.cells_of("sim", 2)
        if cell.tip == tip and (cell.length, cell.gap) in ((1.5, 5), (2.0, 2))
    ]
    cells = [cell for cell in cells if script_of(cell).begins_hot]
    models = [
        find_joints(series_of(trial, 10.0, False)).model
        for trial in joint_matrix.records(cells, (10.0,))[10.0]
    ]
    assert models
    for model in models:
        assert model is not None
        assert model.capacity == pytest.approx(capacity, rel=0.25)


@pytest.mark.parametrize(
    ("tip", "length", "gap", "capacity"),
    [("medium", 1.5, 1.0, 10.0), ("medium", 3.0, 0.5, 10.0), ("large", 2.0, 1.2, 14.0)],
)
def test_where_joints_are_dense_contacts_are_not_taken_for_a_heavier_tip(
    tip: str, length: float, gap: float, capacity: float
) -> None:
    """Without a heat-up and without a rest: work takes up heat as a tip of 37 to 60 ‰·s/K would."""
    cells = [Cell("sim", tip, length, gap)]
    assert script_of(cells[0]).begins_hot
    model = find_joints(series_of(joint_matrix.records(cells, (10.0,))[10.0][0], 10.0, False)).model
    assert model is not None
    assert model.capacity == pytest.approx(capacity, rel=0.25)
