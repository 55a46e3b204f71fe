"""Rows are read in narrow columns, in pieces: text, figures and numbers of a report are those from
whole rows.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from jbclog.analysis.figures import curves
from jbclog.analysis.figures import port as port_figure
from jbclog.analysis.figures.curves import GridSeconds
from jbclog.analysis.figures.from_samples import GrowingColumn, JoinedTrace, has_air, trace
from jbclog.analysis.figures.trace import Grid, Trace
from jbclog.analysis.run import open_run
from jbclog.analysis.run_tables import RunTables, select
from jbclog.analysis.verdict import idle, judged_signals
from jbclog.analysis.verdict.idle import Block, Flags, Floats
from jbclog.report import gather, joints, ports
from jbclog.report.facts import FigureFacts, JointFacts
from jbclog.report.joints import COLUMNS, SHOWN, joints_of
from jbclog.report.ports import PortSamples, samples_of_stations
from jbclog.report.write import as_document, figures_of, report_files
from support import once
from support.records import small_run
from support.records.sealed_run import lose, samples, seal, station, table
from support.virtual.lines import AIR
from support.virtual.recorded_run import run_in
from support.virtual.virtual_run import line_text


def small(home: Path) -> Path:
    return small_run.make_run(home, 20.0)


def hot_air(home: Path) -> Path:
    sim = "tool = 1\n[[station.sim.fault]]\nkind = 'silence'\nat_s = 4\nfor_s = 2\n"
    return run_in(home, line_text(sim).replace("dde", "jtse"), AIR, 10.0)


def free(home: Path) -> Path:
    """With ``--rate max`` the rows have no grid, only times."""
    return run_in(home, line_text(), duration_s=5.0, rate="max")


@pytest.mark.parametrize("made", [small, hot_air, free])
def test_a_report_is_the_same_however_its_rows_are_read(
    made: Callable[[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(made(tmp_path))
    joints = joints_of(run)
    whole = gather.gather(run, joints)
    monkeypatch.setattr(ports, "MOST_ROWS", 0)  # a pass for each station
    monkeypatch.setattr(curves, "BLOCK_ROWS", 7)
    monkeypatch.setattr(RunTables, "groups", in_small_groups)
    pieces = gather.gather(run, joints)
    assert as_document(pieces) == as_document(whole)
    assert figures_of(pieces) == figures_of(whole)


def in_small_groups(
    run: RunTables, table: str, columns: list[str], *, coded: bool = False
) -> Iterator[pa.Table]:
    for group in run._groups(replace(select(table, columns), coded=coded)):
        yield from (group.slice(first, 61) for first in range(0, len(group), 61))


def test_idle_rows_are_found_once_for_metrics_and_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The report is the same, byte for byte, as without what is kept."""
    run, searched, find = small(tmp_path), list[bytes](), idle._idle_rows

    def noted(block: Block, setting: Floats, period_s: float) -> Flags:
        searched.append(idle._digest(block, period_s))
        return find(block, setting, period_s)

    monkeypatch.setattr(idle, "_idle_rows", noted)
    files = report_files(run)
    assert len({*searched}) == len(searched) == 3  # ports, of a block each
    monkeypatch.setattr(idle.KEPT, "rows", lambda _block, _period_s, search: search())
    assert report_files(run) == files
    assert len(searched) == 9


def test_the_scale_of_a_figure_is_found_once_for_its_two_sizes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def again(*_: object, **__: object) -> None:
        raise AssertionError("the drawing looks at all readings again")

    run = small(tmp_path)
    monkeypatch.setattr(port_figure, "scale_of", again)
    once.forget()  # or a figure that another test has drawn is not drawn again
    assert "figures/dde-1-1.svg" in report_files(run)


def test_of_the_joints_what_is_shown_is_in_memory_and_the_table_has_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = joints_of(open_run(seal(tmp_path, [station(rows=2400)], table(samples(2400)))))
    assert found.table.column_names == SHOWN
    assert len(SHOWN) == 8
    whole = found.csv()
    header, *lines = whole.decode("utf-8-sig").splitlines()
    assert header.split(",") == [*COLUMNS]
    assert len(lines) == found.table.num_rows > 10
    monkeypatch.setattr(joints, "ROWS_AT_ONCE", 7)
    assert found.csv() == whole


def test_row_groups_that_are_not_wanted_are_left_out(tmp_path: Path) -> None:
    run = open_run(seal(tmp_path, [station(rows=100_000)], table(samples(100_000))))
    every = [*run.groups("samples", ["tick"])]
    assert len(every) == 4
    some = [*run.groups("samples", ["tick"], wanted=lambda number: number % 2 == 1)]
    assert some == every[1::2]


@pytest.mark.parametrize("made", [small, hot_air, free])
@pytest.mark.parametrize("at_once", [1, 7, 50])
def test_a_trace_made_in_pieces_is_that_of_the_whole_table(
    made: Callable[[Path], Path], at_once: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(made(tmp_path))
    monkeypatch.setattr(ports, "ROWS_A_GROUP", at_once)
    monkeypatch.setattr(RunTables, "groups", in_small_groups)
    for facts, of_station in samples_of_stations(run, ()):
        t0_utc_us = round((run.manifest.t0_utc or 0.0) * 1e6)
        states = "temperature_c" not in judged_signals(facts)
        for port, rows in of_station.items():
            whole = run.samples(facts.name, port)
            of_air, grid = has_air(facts), Grid(t0_utc_us, facts.period_s)
            expected = trace(whole, grid, of_states=states, of_air=of_air)
            found = rows.trace()
            assert rows.rows == len(whole) > 0
            assert rows.last_status == whole["status"].dropna().iloc[-1]
            late_us = whole["late_us"].dropna()
            assert rows.late_us(0.99) == (np.quantile(late_us, 0.99) if len(late_us) else None)
            assert np.array_equal(found.seconds[:], expected.seconds[:])
            for name in ("temperature", "power", "setting"):
                assert np.array_equal(getattr(found, name), getattr(expected, name), equal_nan=True)
            assert (found.status, found.gaps) == (expected.status, expected.gaps)
            assert (found.states, found.period_s) == (expected.states, expected.period_s)
            assert [*found.reasons] == [*expected.reasons]


@pytest.mark.parametrize(("latest", "size"), [(65_535, 2), (65_536, 4), (3_000_000_000, 8)])
def test_how_late_rows_were_takes_as_few_bytes_as_hold_it(
    latest: int, size: int, tmp_path: Path
) -> None:
    columns = samples(100)
    columns["late_us"][50] = latest
    run = open_run(seal(tmp_path, [station(rows=100)], table(columns)))
    ((_, of_station),) = samples_of_stations(run, ())
    assert of_station[1]._late_us.array().dtype.itemsize == size
    assert of_station[1].late_us(1.0) == latest


def test_spans_and_gaps_that_continue_in_the_next_piece_are_one(tmp_path: Path) -> None:
    columns = samples(600)
    lose(columns, slice(95, 160))
    lose(columns, slice(300, 301), "timeout")
    columns["status"][210:230] = "stand"
    kept = np.ones(600, dtype=np.bool_)
    kept[[40, 41, 42, 200, 400, 450, 451]] = False  # the host stood still
    frame = table(columns).to_pandas()[kept]
    grid = Grid(0, 0.1)
    whole = trace(frame, grid)
    for size in (1, 2, 40, 41, 199, 599):
        pieces = JoinedTrace()
        for first in range(0, len(frame), size):
            pieces.add(trace(frame[first : first + size], grid))
        found = pieces.trace()
        assert (found.status, found.gaps) == (whole.status, whole.gaps), size
        assert [*found.reasons] == [*whole.reasons]
        assert np.array_equal(found.temperature, whole.temperature, equal_nan=True)
    assert len(whole.gaps) == 6


def test_a_column_takes_the_type_of_its_widest_values() -> None:
    pieces = [
        np.array(some, kind) for some, kind in (([], "f4"), ([1, np.nan], "f2"), ([7e4], "f4"))
    ]
    column, known = GrowingColumn(), np.array([1, np.nan, 7e4])
    assert not len(column.array())
    for piece in pieces:
        column.add(piece)
    assert np.array_equal(column.array(), known, equal_nan=True)
    column.add(np.arange(9.0, dtype="f2"))
    assert column.array().dtype == np.float32


@pytest.mark.parametrize(("celsius", "size"), [(350, 2), (2048, 2), (2049, 4)])
def test_readings_take_two_bytes_where_these_hold_them(
    celsius: int, size: int, tmp_path: Path
) -> None:
    columns = samples(100)
    columns["temperature_c"][50] = celsius
    run = open_run(seal(tmp_path, [station(rows=100)], table(columns)))
    ((_, of_station),) = samples_of_stations(run, ())
    found = of_station[1].trace()
    assert found.temperature.dtype.itemsize == size
    assert found.temperature[50] == celsius


def test_the_rows_of_a_port_are_small_and_freed_before_its_joints_are_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(small(tmp_path))
    alive: list[weakref.ref[PortSamples]] = []
    traced: list[weakref.ref[Any]] = []
    by_port, figures, chart = ports._by_port, ports._figures, ports.joint_facts

    def noted(*given: Any) -> dict[str, dict[int, PortSamples]]:
        found = by_port(*given)
        alive.extend(
            weakref.ref(one) for of_station in found.values() for one in of_station.values()
        )
        return found

    def charted(*given: Any, **more: Any) -> JointFacts | None:
        left_for_chart.append(sum(one() is not None for one in [*alive, *traced]))
        return chart(*given, **more)

    def drawn(file: str, place: str, one: Trace, context: ports.Context) -> list[FigureFacts]:
        assert isinstance(one.seconds, GridSeconds)
        columns = (one.seconds.ticks, one.temperature, one.power, one.setting, one.reasons.codes)
        assert sum(column.nbytes for column in columns) <= 11 * len(one.seconds)
        left.append(sum(one() is not None for one in alive))
        traced.append(weakref.ref(one.temperature))
        return figures(file, place, one, context)

    left, left_for_chart = list[int](), list[int]()
    monkeypatch.setattr(ports, "_by_port", noted)
    monkeypatch.setattr(ports, "_figures", drawn)
    monkeypatch.setattr(ports, "joint_facts", charted)
    gather.gather(run, joints_of(run))
    assert len(alive) > 1
    assert left == left_for_chart == [*range(len(alive) - 1, -1, -1)]
