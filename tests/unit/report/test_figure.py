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
import sealed_run
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from jbclog.report import style
from jbclog.report.closer import closer
from jbclog.report.figure import draw, figure_svg, spread
from jbclog.report.spans import Span
from jbclog.report.style import NARROW, WIDE, Format, sized
from jbclog.report.trace import Grid, Limit, Mark, Trace, trace


def port(rows: int = 600, **columns: object) -> Trace:
    """The trace of a port that was recorded for `rows` ticks."""
    made = sealed_run.samples(rows) | columns
    samples = sealed_run.table(made).to_pandas()
    return trace(samples, Grid(sealed_run.micros(0), 0.1))


def drawn_temperatures(figure: Figure) -> np.ndarray:
    """Every temperature that is on the paper: of lines, bands and bars."""
    axes = figure.axes[0]
    vertices = [line.get_ydata() for line in axes.lines if len(line.get_ydata()) > 2]
    vertices += [path.vertices[:, 1] for one in axes.collections for path in one.get_paths()]
    return np.concatenate([np.asarray(one, dtype=float) for one in vertices])


@pytest.mark.parametrize("form", [WIDE, NARROW])
def test_a_spike_of_one_sample_in_eight_hours_is_drawn_at_its_full_height(form: Format) -> None:
    temperature = np.full(288_000, 350.0)
    temperature[200_000], temperature[5] = 451, 212
    drawn = drawn_temperatures(draw(port(288_000, temperature_c=temperature), form))
    assert np.nanmax(drawn) == 451
    assert np.nanmin(drawn) == 212


def test_the_axis_holds_every_temperature_limit_and_setting() -> None:
    one = replace(port(), limits=[Limit("high", (-1.0,), (480.0,)), Limit("low", (-1.0,), (10.0,))])
    bottom, top = draw(one, WIDE).axes[0].get_ylim()
    assert bottom < 10
    assert top > 480


def test_the_coarser_scale_loses_nothing_and_says_so() -> None:
    figure = draw(port(20_000), WIDE)
    axes = figure.axes[0]
    assert any(text.get_text() == "coarser scale" for text in axes.texts)
    assert axes.get_ylim()[0] < 25
    heights = axes.transData.transform([[0, c] for c in (25, 100, 300, 340, 350, 360)])[:, 1]
    assert (np.diff(heights) > 0).all()


def test_the_setting_is_drawn_where_it_was_read_and_joined_only_where_it_stood_still() -> None:
    setting = np.full(600, np.nan)
    setting[[50, 100, 150, 200, 250]] = [350, 350, 360, 360, 360]
    one = replace(port(set_c=setting), gaps=[Span(21.0, 24.0, "disconnected")])
    line, dots = (line for line in draw(one, WIDE).axes[0].lines if line.get_color() == style.SETTING)
    joined = list(zip(line.get_xdata(), line.get_ydata(), strict=True))
    ends = [(seconds, celsius) for seconds, celsius in joined if not np.isnan(celsius)]
    assert ends == [(5.0, 350.0), (10.0, 350.0), (15.0, 360.0), (20.0, 360.0), (25.0, 360.0)]
    assert [i for i, (_, celsius) in enumerate(joined) if np.isnan(celsius)] == [2, 5]
    assert (dots.get_marker(), len(dots.get_xdata())) == (".", 5)


def visible_texts(figure: Figure) -> list[Text]:
    ticks = [
        tick.label1
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        for tick in axis.get_major_ticks()
        if min(axis.get_view_interval()) <= tick.get_loc() <= max(axis.get_view_interval())
    ]
    texts = [text for axes in figure.axes for text in axes.texts]
    return [text for text in [*ticks, *texts] if text.get_visible() and text.get_text()]


@pytest.mark.parametrize("form", [WIDE, NARROW])
@pytest.mark.parametrize("rows", [1, 2, 30, 600, 20_000, 60_000])
def test_no_label_covers_another(form: Format, rows: int) -> None:
    limits = [Limit("high", (-1.0,), (352.0,)), Limit("low", (-1.0,), (349.0,))]
    marks = [Mark(Span(1, 2, "high"), "alarm"), Mark(Span(5, 9, "port error 9"), "error"), Mark(Span(1, 1, "low"), "unconfirmed")]
    gaps = [Span(20, 24, "disconnected"), Span(24.1, 24.2, "timeout")]
    with sized(form):
        figure = draw(replace(port(rows), limits=limits, marks=marks, gaps=gaps), form)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    boxes = [(text.get_text(), text.get_window_extent(canvas.get_renderer())) for text in visible_texts(figure)]
    for (one, here), (other, there) in combinations(boxes, 2):
        across = min(here.x1, there.x1) - max(here.x0, there.x0)
        down = min(here.y1, there.y1) - max(here.y0, there.y0)
        assert min(across, down) < 1, f"{one!r} and {other!r} overlap by {across:.1f} × {down:.1f} px"
    for text, box in boxes:
        assert box.x0 >= -1, f"{text!r} is cut off at the left"
        assert box.x1 <= figure.bbox.x1 + 1, f"{text!r} is cut off at the right"


def test_labels_are_moved_apart_as_little_as_needed() -> None:
    assert spread([300, 350, 380], 10, 0, 400) == [300, 350, 380]
    assert spread([349, 350, 352], 10, 0, 400) == [349, 359, 369]
    assert spread([390, 395, 399], 10, 0, 400) == [380, 390, 400]
    assert spread([], 10, 0, 1) == []


def test_gaps_are_hatched_by_reason_and_single_lost_readings_do_not_hide_an_eight_hour_curve() -> None:
    short = draw(replace(port(200), gaps=[Span(5, 8, "disconnected"), Span(10, 10.1, "timeout")]), WIDE)
    patches = [patch for patch in short.axes[0].patches if patch.get_zorder() == 1.5]
    assert [patch.get_hatch() for patch in patches] == ["xxx", None]
    assert patches[1].get_width() >= 20 / 800
    lost = [Span(30.0 * i, 30.0 * i + 0.1, "timeout") for i in range(900)]
    long = draw(replace(port(288_000), gaps=[*lost, Span(1000, 1003, "disconnected")]), WIDE)
    assert len([patch for patch in long.axes[0].patches if patch.get_zorder() == 1.5]) == 1
    assert [label.get_text() for label in long.axes[2].get_yticklabels()] == ["status", "no data"]


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_very_short_run_can_be_drawn(rows: int) -> None:
    assert np.nanmax(drawn_temperatures(draw(port(rows, temperature_c=np.full(rows, 77.0)), WIDE))) == 77 if rows > 2 else True
    ElementTree.fromstring(figure_svg(port(rows), NARROW))


def test_a_port_that_was_never_read_can_be_drawn() -> None:
    columns = sealed_run.samples(50)
    sealed_run.lose(columns, slice(0, 50))
    one = trace(sealed_run.table(columns).to_pandas(), Grid(sealed_run.micros(0), 0.1))
    assert one.gaps == [Span(0, 5, "disconnected")]
    ElementTree.fromstring(figure_svg(one, WIDE))


def test_the_same_trace_gives_the_same_bytes_without_a_date() -> None:
    text = figure_svg(port(3000), WIDE)
    assert text == figure_svg(port(3000), WIDE)
    assert "<dc:date>" not in text
    assert "Matplotlib v" not in text


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


def test_pyplot_and_its_global_state_are_not_used() -> None:
    code = "import jbclog.report, sys; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
