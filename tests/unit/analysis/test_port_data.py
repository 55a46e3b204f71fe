"""The rows of a port as arrays: what was read, what is in force, gaps, and slices of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import jbclog
from jbclog.analysis.port_data import SETTING_HOLDS_S, PortData, Texts
from jbclog.core.errors import UsageError
from support.records.sealed_run import T0_UTC_S, lose, samples, seal, station, table

ROWS = 600
HZ = 10.0
PERIOD_S = 1 / HZ


def recorded(out: Path, columns: dict[str, Any], *others: dict[str, Any]) -> jbclog.Run:
    ports = [station(rows=ROWS, ports=(1, 2))]
    return jbclog.open_run(seal(out, ports, table(columns, *others), t0_utc=T0_UTC_S))


def of_port_2() -> dict[str, Any]:
    columns = samples(ROWS, port=2, seed=2)
    lose(columns, slice(100, 130), "timeout")
    return columns


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> jbclog.Run:
    return recorded(tmp_path_factory.mktemp("run"), samples(ROWS), of_port_2())


@pytest.fixture(scope="module")
def data(run: jbclog.Run) -> PortData:
    return run.port("dde-1", 2)


def as_read(run: jbclog.Run, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    column = run.samples("dde-1", 2)[name]
    return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan))


def test_readings_are_those_of_the_samples_and_nan_where_not_read(
    run: jbclog.Run, data: PortData
) -> None:
    assert len(data) == ROWS
    assert data.key == ("dde-1", 2)
    for readings, name in (
        (data.temperature, "temperature_c"),
        (data.power, "power_permille"),
        (data.setpoint_read, "setpoint_c"),
        (data.columns["alarm_high"], "alarm_high"),
    ):
        assert isinstance(readings, np.ndarray)
        assert readings.dtype == np.float32
        np.testing.assert_array_equal(readings, as_read(run, name))
    assert np.isnan(data.temperature).sum() == 30


def test_texts_are_those_of_the_samples(run: jbclog.Run, data: PortData) -> None:
    rows = run.samples("dde-1", 2)
    expected = rows["status"].astype(object).where(rows["status"].notna(), None)
    assert data.status.arrow().to_pylist() == list(expected)
    assert data.working.tolist() == [word == "working" for word in expected]
    assert not data.is_read("status")[100:130].any()
    assert data.is_read("status").sum() == ROWS - 30
    quality = data.columns["quality"]
    assert isinstance(quality, Texts)
    assert quality.is_among(["timeout"]).sum() == 30


def test_each_row_was_due_on_the_grid_and_read_after_it(run: jbclog.Run, data: PortData) -> None:
    np.testing.assert_allclose(data.seconds, np.arange(ROWS) * PERIOD_S, rtol=0, atol=1e-12)
    rows = run.samples("dde-1", 2)
    np.testing.assert_array_equal(data.time_us, rows["time"].astype("int64"))
    after = data.read_s - data.seconds
    answered = ~np.isnan(data.temperature)
    elapsed_s = data.time_us / 1e6 - T0_UTC_S
    np.testing.assert_allclose(data.read_s[answered], elapsed_s[answered], rtol=0, atol=1e-6)
    assert (np.diff(data.read_s) >= 0).all()
    assert (after[~answered][1:] == 0).all()


def test_without_a_grid_rows_were_due_when_they_were_read(tmp_path: Path) -> None:
    facts = station(rows=ROWS)
    facts.period_s = None
    columns = samples(ROWS)
    columns["time"] = columns["time"] + 3000 * (np.arange(ROWS) % 7)
    run = jbclog.open_run(seal(tmp_path, [facts], table(columns), t0_utc=T0_UTC_S))
    data = run.port("dde-1", 1)
    assert data.period_s is None
    np.testing.assert_allclose(data.seconds, data.time_us / 1e6 - T0_UTC_S, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(data.read_s, data.seconds)


def test_the_setpoint_in_force_is_the_last_one_read_while_it_holds(tmp_path: Path) -> None:
    columns = samples(ROWS)
    columns["setpoint_c"] = np.full(ROWS, np.nan)
    columns["setpoint_c"][[20, 70, 400]] = [350, 330, 320]
    data = recorded(tmp_path, columns).port("dde-1", 1)
    holds = round(SETTING_HOLDS_S * HZ)
    expected = np.full(ROWS, np.nan)
    expected[20:70] = 350
    expected[70 : 70 + holds + 1] = 330
    expected[400 : 400 + holds + 1] = 320
    np.testing.assert_array_equal(data.setpoint, expected)


def test_a_tool_that_was_pulled_is_not_in_its_place(tmp_path: Path) -> None:
    columns = samples(ROWS)
    columns["tool"] = np.full(ROWS, np.nan)
    columns["tool"][::50] = 2.0
    columns["tool"][[200, 250]] = 0.0
    columns["port_error"] = np.where(np.arange(ROWS) == 430, 4.0, np.nan)
    columns["port_error"][[420, 440]] = 0.0
    data = recorded(tmp_path, columns).port("dde-1", 1)
    expected = np.ones(ROWS, dtype=bool)
    expected[151:300] = False  # from the last reading with the tool to the first one
    expected[421:440] = False
    assert data.in_place.tolist() == expected.tolist()


@pytest.mark.parametrize("port", [1, 2])
def test_the_gaps_are_those_of_the_run(run: jbclog.Run, port: int) -> None:
    data = run.port("dde-1", port)
    for signal in ("temperature_c", "power_permille", "setpoint_c", "status"):
        listed = run.gaps("dde-1", port, signal)
        gaps = [*data.gaps(signal)]
        assert [gap.seconds for gap in gaps] == listed["seconds"].tolist()
        assert [gap.reasons_text for gap in gaps] == listed["reasons"].tolist()
        assert [gap.missing for gap in gaps] == listed["missing"].tolist()
    longest = data.gaps().longest_s
    assert longest == (pytest.approx(31 * PERIOD_S, abs=0.01) if port == 2 else 0)


def test_a_slice_shares_the_arrays_and_has_the_gaps_of_its_rows(data: PortData) -> None:
    part = data.between(5.0, 12.0)
    assert part.seconds[[0, -1]].tolist() == pytest.approx([5.0, 11.9])
    assert len(part) == 70
    for mine, whole in (
        (part.time_us, data.time_us),
        (part.temperature, data.temperature),
        (part.setpoint, data.setpoint),
        (part.in_place, data.in_place),
        (part.status.codes, data.status.codes),
        (part.columns["alarm_high"], data.columns["alarm_high"]),
    ):
        assert isinstance(mine, np.ndarray)
        assert isinstance(whole, np.ndarray)
        assert np.shares_memory(mine, whole)
    np.testing.assert_array_equal(part.setpoint, data.setpoint[50:120])
    (gap,) = part.gaps()
    assert (gap.missing, gap.at_least) == (20, True)
    assert len(data[:0].gaps()) == 0


def test_its_table_has_a_row_for_each_row(run: jbclog.Run, data: PortData) -> None:
    table = data.frame()
    rows = run.samples("dde-1", 2)
    pd.testing.assert_series_equal(table["time"], rows["time"])
    assert list(table["status"].astype(object).dropna()) == list(rows["status"].dropna())
    np.testing.assert_array_equal(table["seconds"], data.seconds)
    np.testing.assert_array_equal(table["temperature_c"], data.temperature)
    np.testing.assert_array_equal(table["setpoint_c"], data.setpoint)
    np.testing.assert_array_equal(table["setpoint_read_c"], data.setpoint_read)
    assert table["in_place"].all()


def test_what_a_port_does_not_have_is_refused(run: jbclog.Run, data: PortData) -> None:
    with pytest.raises(UsageError, match=r"it has 1, 2"):
        run.port("dde-1", 3)
    with pytest.raises(UsageError, match=r"it has dde-1"):
        run.port("dde-2", 1)
    with pytest.raises(UsageError, match=r"'humidity' was not read; there are temperature_c, "):
        data.gaps("humidity")


def test_parts_with_different_texts_are_one_column(tmp_path: Path) -> None:
    """Each part has its own dictionary."""
    first, second = samples(ROWS), samples(ROWS)
    first["status"][:300] = "sleep"
    second["status"][:] = "hibernation"
    for name in ("time", "tick"):
        second[name] = second[name] + (60_000_000 if name == "time" else ROWS)
    run = recorded(tmp_path, first, second)
    data = run.port("dde-1", 1)
    words = data.status.arrow().to_pylist()
    assert words == 300 * ["sleep"] + 300 * ["working"] + 600 * ["hibernation"]


def test_its_figure_shows_curves_and_gaps(run: jbclog.Run, data: PortData) -> None:
    """The same as the run's figure of the port, which has no alarms, limits and joints here."""
    own, of_run = data.plot(), run.plot("dde-1", 2)
    assert [axes.get_label() for axes in own.axes] == [axes.get_label() for axes in of_run.axes]
    for axes, others in zip(own.axes, of_run.axes, strict=True):
        assert axes.get_title() == others.get_title()
        for line, other in zip(axes.lines, others.lines, strict=False):
            np.testing.assert_array_equal(line.get_ydata(), other.get_ydata())
    with pytest.raises(UsageError, match="dde-1 port 2 has no samples"):
        data[:0].plot()
