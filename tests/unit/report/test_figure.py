"""The figures: nothing disappears, nothing covers anything, and the same run gives the same bytes."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from jbclog.report.figure import closer, draw, figure_svg
from jbclog.report.scale import round_marks, spread
from jbclog.report.style import NARROW, WIDE, Format
from jbclog.report.trace import Grid, Limit, Mark, Span, Trace, trace
from support.readers.drawn import boxes, corners, fields, shapes, texts, values
from support.records import sealed_run


def port(rows: int = 600, **columns: object) -> Trace:
    """The trace of a port that was recorded for `rows` ticks."""
    made = sealed_run.samples(rows) | columns
    samples = sealed_run.table(made).to_pandas()
    return trace(samples, Grid(sealed_run.micros(0), 0.1))


def drawn_temperatures(one: Trace, form: Format = WIDE) -> np.ndarray:
    """Every temperature that is on the paper: of lines, bands, bars and dots."""
    drawing = draw(one, form)
    return values(fields(drawing, one, form)[0], corners(drawing, "temperature")[:, 1])


@pytest.mark.parametrize("form", [WIDE, NARROW])
def test_a_spike_of_one_sample_in_eight_hours_is_drawn_at_its_full_height(form: Format) -> None:
    temperature = np.full(288_000, 350.0)
    temperature[200_000], temperature[5] = 451, 212
    drawn = drawn_temperatures(port(288_000, temperature_c=temperature), form)
    assert drawn.max() == pytest.approx(451)
    assert drawn.min() == pytest.approx(212)


def test_the_axis_holds_every_temperature_limit_and_setting() -> None:
    one = replace(port(), limits=[Limit("high", (-1.0,), (480.0,)), Limit("low", (-1.0,), (10.0,))])
    scale = fields(draw(one, WIDE), one, WIDE)[0].y
    assert scale.low < 10
    assert scale.high > 480


def test_the_coarser_scale_loses_nothing_and_says_so() -> None:
    one = port(20_000)
    drawing = draw(one, WIDE)
    scale = fields(drawing, one, WIDE)[0].y
    assert "coarser scale" in texts(drawing)
    assert scale.low < 25
    assert (np.diff(scale.at([25, 100, 300, 340, 350, 360])) < 0).all()  # upwards


def test_the_setting_is_drawn_where_it_was_read_and_joined_only_where_it_stood_still() -> None:
    setting = np.full(600, np.nan)
    setting[[50, 100, 150, 200, 250]] = [350, 350, 360, 360, 360]
    one = replace(port(set_c=setting), gaps=[Span(21.0, 24.0, "disconnected")])
    drawing = draw(one, WIDE)
    panel = fields(drawing, one, WIDE)[0]
    line, dots = shapes(drawing, "set")
    joined = [(panel.x.at([5, 10]), 350), (panel.x.at([15, 20]), 360)]
    assert [(part[:, 0].tolist(), values(panel, part[:, 1]).round(6).tolist()) for part in line.parts] == [
        (pytest.approx(list(x)), [celsius, celsius]) for x, celsius in joined
    ]
    assert len(dots.parts) == 5


@pytest.mark.parametrize("form", [WIDE, NARROW])
@pytest.mark.parametrize("rows", [1, 2, 30, 600, 20_000, 60_000])
def test_no_label_covers_another(form: Format, rows: int) -> None:
    limits = [Limit("high", (-1.0,), (352.0,)), Limit("low", (-1.0,), (349.0,))]
    marks = [Mark(Span(1, 2, "high"), "alarm"), Mark(Span(5, 9, "port error 9"), "error"), Mark(Span(1, 1, "low"), "unconfirmed")]
    gaps = [Span(20, 24, "disconnected"), Span(24.1, 24.2, "timeout")]
    drawing = draw(replace(port(rows), limits=limits, marks=marks, gaps=gaps), form)
    for one, other in combinations(boxes(drawing), 2):
        across = min(one.right, other.right) - max(one.left, other.left)
        down = min(one.bottom, other.bottom) - max(one.top, other.top)
        assert min(across, down) < 0.5, f"{one.text!r} and {other.text!r} overlap by {across:.1f} × {down:.1f} points"
    for box in boxes(drawing):
        assert box.left >= 0, f"{box.text!r} is cut off at the left"
        assert box.right <= drawing.width, f"{box.text!r} is cut off at the right"


def test_labels_are_moved_apart_as_little_as_needed() -> None:
    assert spread([300, 350, 380], 10, 0, 400) == [300, 350, 380]
    assert spread([349, 350, 352], 10, 0, 400) == [349, 359, 369]
    assert spread([390, 395, 399], 10, 0, 400) == [380, 390, 400]
    assert spread([], 10, 0, 1) == []


@pytest.mark.parametrize(("low", "high", "most"), [(0, 1000, 3), (290, 402, 5), (-3, 4, 5), (349.2, 350.9, 5), (20, 480, 5)])
def test_marks_of_an_axis_are_round_and_not_too_many(low: float, high: float, most: int) -> None:
    marks = round_marks(low, high, most)
    assert 1 <= len(marks) <= most + 1
    assert all(low <= mark <= high and mark == int(mark) for mark in marks)
    assert len({*np.diff(marks)}) <= 1


def test_gaps_are_hatched_by_reason_and_single_lost_readings_do_not_hide_an_eight_hour_curve() -> None:
    one = replace(port(200), gaps=[Span(5, 8, "disconnected"), Span(10, 10.1, "timeout")])
    short = draw(one, WIDE)
    gaps = shapes(short, "gap")
    assert len(gaps) == 4  # both, over the temperature and over the power
    assert len(shapes(short, "hatch xxx")) == 3  # and in the lane; a sliver has none
    sliver = np.ptp(gaps[1].parts[0][:, 0])
    assert sliver >= 1.4 * np.ptp(fields(short, one, WIDE)[0].x.at([0, 20])) / 800
    lost = [Span(30.0 * i, 30.0 * i + 0.1, "timeout") for i in range(900)]
    long = draw(replace(port(288_000), gaps=[*lost, Span(1000, 1003, "disconnected")]), WIDE)
    assert len(shapes(long, "gap")) == 2
    assert {"status", "no data"} <= {*texts(long)}


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_very_short_run_can_be_drawn(rows: int) -> None:
    assert drawn_temperatures(port(rows, temperature_c=np.full(rows, 77.0))) == pytest.approx(77, abs=3)  # dots have a size
    ElementTree.fromstring(figure_svg(port(rows), NARROW))


def test_a_port_that_was_never_read_can_be_drawn() -> None:
    columns = sealed_run.samples(50)
    sealed_run.lose(columns, slice(0, 50))
    one = trace(sealed_run.table(columns).to_pandas(), Grid(sealed_run.micros(0), 0.1))
    assert one.gaps == [Span(0, 5, "disconnected")]
    ElementTree.fromstring(figure_svg(one, WIDE))


def test_the_same_trace_gives_the_same_bytes() -> None:
    text = figure_svg(port(3000), WIDE)
    assert text == figure_svg(port(3000), WIDE)


def test_rows_without_a_grid_are_placed_by_their_times() -> None:
    samples: pd.DataFrame = sealed_run.table(sealed_run.samples(50)).to_pandas()
    one = trace(samples, Grid(sealed_run.micros(0), None))
    assert one.period_s == pytest.approx(0.1, abs=0.01)
    assert one.end == pytest.approx(5, abs=0.1)


def test_a_long_run_gets_a_closer_look_at_its_first_alarm() -> None:
    long = replace(port(6000), marks=[Mark(Span(300, 302, "high"), "alarm")])
    near = closer(long)
    assert near is not None
    assert near[1] == "the first alarm"
    assert near[0].start == pytest.approx(271, abs=0.1)
    assert near[0].end == pytest.approx(331, abs=0.2)
    assert closer(port(600)) is None
    hottest = closer(port(6000, temperature_c=np.concatenate([[900.0], np.full(5999, 350.0)])))
    assert hottest is not None
    assert hottest[1] == "the hottest reading"
    assert hottest[0].start == 0


def test_no_plotting_library_is_loaded() -> None:
    code = "import jbclog.report, sys; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
