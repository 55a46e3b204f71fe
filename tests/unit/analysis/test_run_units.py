"""`Run.units()`: joints, energy, coverage and alarms of each unit, against the rows themselves.

What is not known of a unit is missing; a lost reading never makes its energy smaller in silence.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from support.product import EventRow, RunLoss, RunMetadata, Severity, open_run
from support.records.sealed_run import alarm, lose, micros, samples, seal, station, table

ROWS = 900  # 90 s at 10 Hz
RATED_W = 130.0
STAYS = (("SN-1", 10.02, 40.07), ("SN-2", 40.07, 70.0), ("SN-3", 70.0, None))

Columns = dict[str, NDArray[Any]]


def came(second: float, serial: str) -> EventRow:
    return EventRow(micros(second), "unit.begin", Severity.INFO, f"{serial} came.", raw=serial)


def ports() -> tuple[Columns, Columns]:
    return samples(ROWS, port=1, seed=1), samples(ROWS, port=2, seed=2)


def units_of(
    out: Path,
    columns: tuple[Columns, Columns],
    rated_w: float | None = RATED_W,
    *more: EventRow,
    lost: RunLoss | None = None,
) -> pd.DataFrame:
    """The units of a run of two ports, on whose bench three serials were read."""
    facts = station(ports=(1, 2), rows=int(columns[0]["tick"][-1]) + 1)
    facts.rated_power_w = rated_w
    told = [came(start, serial) for serial, start, _ in STAYS]
    events = sorted([*told, *more], key=lambda event: event.time)
    metadata = RunMetadata(units=["SN-0"])
    folder = seal(out, [facts], table(*columns), events, metadata=metadata, lost=lost)
    return open_run(folder).units()


def joules(columns: Columns, start: float, stop: float) -> float:
    """The area under straight lines between the readings, on a grid of 10 ms."""
    known = ~np.isnan(columns["power_permille"])
    ticks = columns["tick"][known] / 10
    moments = np.arange(start, stop, 0.01) + 0.005
    return float(np.interp(moments, ticks, columns["power_permille"][known]).sum() * 0.01 * 0.13)


def test_each_unit_has_the_energy_and_the_joints_of_its_time(tmp_path: Path) -> None:
    columns = ports()
    units = units_of(tmp_path, columns)
    assert list(units["unit"]) == ["SN-1", "SN-2", "SN-3", "SN-0"]
    for row, (_, start, stop) in zip(units.itertuples(), STAYS[:2], strict=False):
        assert stop is not None
        assert row.energy_j == pytest.approx(sum(joules(one, start, stop) for one in columns), 1e-3)
        assert row.coverage == 100
        assert row.alarms == 0
    run = open_run(next(tmp_path.iterdir()))
    begun = run.joints().groupby(run.unit_at(run.joints()["start"]).to_numpy()).size()
    assert [int(count) for count in units["joints"][:2]] == [begun["SN-1"], begun["SN-2"]]
    assert min(begun[:2]) >= 10


def test_nothing_is_known_of_a_unit_whose_time_is_not_known(tmp_path: Path) -> None:
    units = units_of(tmp_path, ports())
    figures = units[["joints", "energy_j", "coverage", "alarms"]]
    assert units["stop"].isna().tolist() == [False, False, True, True]
    assert figures.isna().all(axis=1).tolist() == [False, False, True, True]


def test_a_gap_takes_the_energy_and_the_joints_of_its_unit_alone(tmp_path: Path) -> None:
    columns = ports()
    lose(columns[1], slice(500, 530))
    units = units_of(tmp_path, columns)
    first, second = units.iloc[0], units.iloc[1]
    assert (first["coverage"], second["coverage"]) == (100, round(100 * 568 / 598, 3))
    assert pd.isna(second["energy_j"])
    assert pd.isna(second["joints"])
    assert first["energy_j"] > 0
    assert first["joints"] > 5


def test_a_gap_over_the_change_of_units_takes_the_energy_of_both(tmp_path: Path) -> None:
    columns = ports()
    lose(columns[0], slice(399, 403))  # of which each has less than what counts as a gap
    assert units_of(tmp_path, columns)["energy_j"].isna().all()


def test_what_a_crash_cut_off_takes_the_energy_of_its_unit(tmp_path: Path) -> None:
    one, two = samples(600, port=1, seed=1), samples(600, port=2, seed=2)
    units = units_of(tmp_path, (one, two), lost=RunLoss(2.0, "at most 2 s"))
    assert units["energy_j"].isna().tolist() == [False, True, True, True]
    assert units["joints"].isna().tolist() == [False, True, True, True]


def test_rows_that_are_absent_lower_the_coverage_too(tmp_path: Path) -> None:
    whole, holed = ports()
    kept = (holed["tick"] < 500) | (holed["tick"] >= 530)
    units = units_of(tmp_path, (whole, {name: cells[kept] for name, cells in holed.items()}))
    assert units["coverage"][0] == 100
    assert 94.9 < units["coverage"][1] < 95.1
    assert pd.isna(units["energy_j"][1])


def test_a_single_lost_reading_does_not_lower_the_energy(tmp_path: Path) -> None:
    columns = ports()
    before = units_of(tmp_path / "whole", columns)["energy_j"][0]
    lose(columns[0], slice(250, 251))
    units = units_of(tmp_path / "one lost", columns)
    assert units["energy_j"][0] == pytest.approx(before, 0.01)
    assert units["energy_j"][0] == pytest.approx(
        sum(joules(one, 10.02, 40.07) for one in columns), 1e-3
    )
    assert units["coverage"][0] < 100


def test_without_a_declared_power_there_are_no_joules(tmp_path: Path) -> None:
    units = units_of(tmp_path, ports(), None)
    assert units["energy_j"].isna().all()
    assert units["coverage"][0] == 100


def test_an_alarm_counts_for_each_unit_that_it_met(tmp_path: Path) -> None:
    cleared = alarm(45)._replace(kind="alarm.cleared", value=None, raw="high", text="It cleared.")
    units = units_of(tmp_path, ports(), RATED_W, alarm(39), cleared)
    assert units["alarms"][:2].tolist() == [1, 1]
