"""The figure of a port: nothing disappears, nothing covers anything, and the same run gives the
same bytes.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from matplotlib.patches import PathPatch

from jbclog.analysis.figures.canvas import new_figure, svg_text
from jbclog.analysis.figures.curves import Span
from jbclog.analysis.figures.from_samples import trace
from jbclog.analysis.figures.lanes import lanes_of
from jbclog.analysis.figures.port import draw, draw_at, height_pt, scale_of
from jbclog.analysis.figures.style import HATCHES, NARROW, WIDE, Format
from jbclog.analysis.figures.ticks import round_values, spread
from jbclog.analysis.figures.trace import Grid, Limit, Mark, MarkKind, Trace
from support.readers.drawn import boxes, corners, panel, parts, seconds, texts
from support.records import sealed_run

T0 = sealed_run.micros(0)


def port(rows: int = 600, **columns: object) -> Trace:
    """The trace of a port that was recorded for `rows` ticks."""
    made = sealed_run.samples(rows) | columns
    samples = sealed_run.table(made).to_pandas()
    return trace(samples, Grid(T0, 0.1))


def drawn_temperatures(one: Trace, form: Format = WIDE) -> np.ndarray:
    """Every temperature that is drawn: of lines, bands, bars and dots."""
    return np.asarray(corners(draw(one, form), "temperature")[:, 1])


@pytest.mark.parametrize("form", [WIDE, NARROW])
def test_a_spike_of_one_sample_in_eight_hours_is_drawn_at_its_full_height(form: Format) -> None:
    temperature = np.full(288_000, 350.0)
    temperature[200_000], temperature[5] = 451, 212
    drawn = drawn_temperatures(port(288_000, temperature_c=temperature), form)
    assert drawn.max() == pytest.approx(451)
    assert drawn.min() == pytest.approx(212)


def test_the_axis_holds_every_temperature_limit_and_setting() -> None:
    one = replace(port(), limits=[Limit("high", (-1.0,), (480.0,)), Limit("low", (-1.0,), (10.0,))])
    low, high = panel(draw(one, WIDE), 0).get_ylim()
    assert low < 10
    assert high > 480


def test_the_coarser_scale_loses_nothing_and_says_so() -> None:
    one = port(20_000)
    figure = draw(one, WIDE)
    axes = panel(figure, 0)
    assert "coarser scale" in texts(figure)
    assert axes.get_ylim()[0] < 25
    heights = axes.transData.transform(
        [(axes.get_xlim()[0], celsius) for celsius in (25, 100, 300, 340, 350, 360)]
    )[:, 1]
    assert (np.diff(heights) > 0).all()
    assert heights[1] - heights[0] < 0.5 * (heights[4] - heights[3]) * 75 / 10


@pytest.mark.parametrize("form", [WIDE, NARROW])
def test_a_scale_that_is_known_gives_the_same_figure(form: Format) -> None:
    one = port(20_000)
    assert scale_of(one).knee is not None
    assert svg_text(draw(one, form, scale_of(one))) == svg_text(draw(one, form))


def test_a_figure_for_a_notebook_has_one_scale_a_panel() -> None:
    one = port(20_000)
    lanes = lanes_of(one, WIDE)
    figure = new_figure(WIDE.width_pt, height_pt(one, lanes, WIDE))
    axes = draw_at(figure, 0.0, one, lanes, WIDE, has_knee=False)[0]
    assert (axes.get_yscale(), "coarser scale" in texts(figure)) == ("linear", False)
    assert axes.get_ylim()[0] < 25


def test_the_setting_is_drawn_where_it_was_read_and_joined_only_where_it_stood_still() -> None:
    setting = np.full(600, np.nan)
    setting[[50, 100, 150, 200, 250]] = [350, 350, 360, 360, 360]
    one = replace(port(setpoint_c=setting), gaps=[Span(21.0, 24.0, "disconnected")])
    found = parts(draw(one, WIDE), "set")
    lines, dots = (
        [part for part in found if len(part) < 5],
        [part for part in found if len(part) == 5],
    )
    assert [(seconds(T0, part[:, 0]).round(3).tolist(), part[:, 1].tolist()) for part in lines] == [
        ([5, 10], [350, 350]),
        ([15, 20], [360, 360]),
    ]
    assert len(dots) == 5


@pytest.mark.parametrize("form", [WIDE, NARROW])
@pytest.mark.parametrize("rows", [1, 2, 30, 600, 20_000, 60_000])
def test_no_label_covers_another(form: Format, rows: int) -> None:
    limits = [Limit("high", (-1.0,), (352.0,)), Limit("low", (-1.0,), (349.0,))]
    marks = [
        Mark(Span(1, 2, "high"), MarkKind.ALARM),
        Mark(Span(5, 9, "port error 9"), MarkKind.ERROR),
        Mark(Span(1, 1, "low"), MarkKind.UNCONFIRMED),
    ]
    gaps = [Span(20, 24, "disconnected"), Span(24.1, 24.2, "timeout")]
    figure = draw(replace(port(rows), limits=limits, marks=marks, gaps=gaps), form)
    placed = boxes(figure)
    assert len(placed) > 8
    for one, other in combinations(placed, 2):
        across = min(one.right, other.right) - max(one.left, other.left)
        down = min(one.top, other.top) - max(one.bottom, other.bottom)
        assert min(across, down) < 0.5, (
            f"{one.text!r} and {other.text!r} overlap by {across:.1f} × {down:.1f} points"
        )
    for box in placed:
        assert box.left >= 0, f"{box.text!r} is cut off at the left"
        assert box.right <= form.width_pt, f"{box.text!r} is cut off at the right"


def test_labels_are_moved_apart_as_little_as_needed() -> None:
    assert spread([300, 350, 380], 10, 0, 400) == [300, 350, 380]
    assert spread([349, 350, 352], 10, 0, 400) == [349, 359, 369]
    assert spread([390, 395, 399], 10, 0, 400) == [380, 390, 400]
    assert spread([], 10, 0, 1) == []


@pytest.mark.parametrize(
    ("low", "high", "most"),
    [(0, 1000, 3), (290, 402, 5), (-3, 4, 5), (349.2, 350.9, 5), (20, 480, 5)],
)
def test_marks_of_an_axis_are_round_and_not_too_many(low: float, high: float, most: int) -> None:
    marks = round_values(low, high, most)
    assert 1 <= len(marks) <= most + 1
    assert all(low <= mark <= high and mark == int(mark) for mark in marks)
    assert len({*np.diff(marks)}) <= 1


def test_gaps_are_hatched_by_reason_and_lost_readings_do_not_hide_a_long_curve() -> None:
    one = replace(port(200), gaps=[Span(5, 8, "disconnected"), Span(10, 10.1, "timeout")])
    short = draw(one, WIDE)
    gaps = parts(short, "gap")
    assert len(gaps) == 4  # both, over the temperature and over the power
    hatched = [
        patch for patch in short.findobj(PathPatch) if patch.get_hatch() == HATCHES["disconnected"]
    ]
    assert len(hatched) == 3  # and in the lane; a sliver has none
    slivers = [np.ptp(seconds(T0, gap[:, 0])) for gap in gaps]
    assert min(slivers) >= 1.4 * 20 / 800
    lost = [Span(30.0 * i, 30.0 * i + 0.1, "timeout") for i in range(900)]
    long = draw(replace(port(288_000), gaps=[*lost, Span(1000, 1003, "disconnected")]), WIDE)
    assert len(parts(long, "gap")) == 2
    assert {"status", "no data"} <= {*texts(long)}


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_very_short_run_can_be_drawn(rows: int) -> None:
    # dots have a size
    assert drawn_temperatures(port(rows, temperature_c=np.full(rows, 77.0))) == pytest.approx(
        77, abs=3
    )
    ElementTree.fromstring(svg_text(draw(port(rows), NARROW)))


def test_a_port_that_was_never_read_can_be_drawn() -> None:
    columns = sealed_run.samples(50)
    sealed_run.lose(columns, slice(0, 50))
    one = trace(sealed_run.table(columns).to_pandas(), Grid(T0, 0.1))
    drawn = replace(one, gaps=[Span(0, 5, "disconnected")])
    ElementTree.fromstring(svg_text(draw(drawn, WIDE)))


def test_the_same_trace_gives_the_same_bytes() -> None:
    assert svg_text(draw(port(3000), WIDE)) == svg_text(draw(port(3000), WIDE))


def test_rows_without_a_grid_are_placed_by_their_times() -> None:
    samples: pd.DataFrame = sealed_run.table(sealed_run.samples(50)).to_pandas()
    one = trace(samples, Grid(T0, None))
    assert one.period_s == pytest.approx(0.1, abs=0.01)
    assert one.end == pytest.approx(5, abs=0.1)


def test_an_alarm_is_drawn_in_its_lane_and_behind_the_curves_where_it_was() -> None:
    figure = draw(replace(port(), marks=[Mark(Span(20.0, 24.0, "high"), MarkKind.ALARM)]), WIDE)
    (lane,), shaded = parts(figure, "alarm"), parts(figure, "mark")
    assert len(shaded) == 2  # over the temperature and over the power
    for part in (lane, *shaded):
        assert sorted({*seconds(T0, part[:, 0]).round(3)}) == [20, 24]
    assert "alarm" in texts(figure)


def test_the_axes_name_what_they_measure_and_its_unit() -> None:
    figure = draw(replace(port(), limits=[Limit("high", (-1.0,), (380.0,))]), WIDE)
    words = texts(figure)
    assert {"Tip temperature in °C", "Power in ‰", "high 380", "status"} <= {*words}
    assert any(word.startswith("max ") for word in words)
