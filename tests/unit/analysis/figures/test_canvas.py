"""Figures as SVG: small, the same bytes each time, lines broken where nothing is known, and no text
that becomes anything else.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from jbclog.analysis.figures.axes import dots, panel, rectangles
from jbclog.analysis.figures.canvas import new_figure, styled, svg_text

TIP = "Tip 350 °C ✓"


def drawn(text: str = TIP) -> Figure:
    with styled():
        figure = new_figure(200, 100)
        axes = panel(figure, 0, 0, 200, 100)
        axes.set_axis_off()
        axes.set_xlim(0, 200)
        axes.set_ylim(100, 0)
        axes.plot([10, 50, np.nan, 60, 90], [10, 20, 0, 30, 40], color="#0b4f8a", dashes=(1, 2))
        axes.fill_between([10, 20, 30], [50, 50, 50], [40, 30, 45], facecolor="#efc98a")
        rectangles(
            axes, [(100, 140, 10, 30)], "gap", facecolor="#f4f6f8", edgecolor="#8d99a6", hatch="xxx"
        )
        axes.text(10, 90, text, weight="bold")
    return figure


def elements(svg: str) -> list[ElementTree.Element]:
    return [
        one
        for one in ElementTree.fromstring(svg).iter()
        if one.tag.rpartition("}")[2] in ("path", "text")
    ]


def test_a_line_is_broken_where_nothing_is_known() -> None:
    lines = [
        one
        for one in elements(svg_text(drawn()))
        if "stroke-dasharray" in one.attrib.get("style", "")
    ]
    assert [one.attrib["d"] for one in lines] == ["M 10 10 50 20 M 60 30 90 40"]


@pytest.mark.parametrize(
    "text", ["</text><script>alert(1)</script>", ") Tj (", "&<>\"'", "$\\frac{1}{0}$", "$a$ 王"]
)
def test_no_text_becomes_anything_else(text: str) -> None:
    root = ElementTree.fromstring(svg_text(drawn(text)))
    assert {one.tag.rpartition("}")[2] for one in root.iter()} <= {
        "svg",
        "defs",
        "pattern",
        "clipPath",
        "rect",
        "path",
        "use",
        "text",
    }
    assert [one.text for one in elements(svg_text(drawn(text))) if one.tag.endswith("text")] == [
        text
    ]


def test_text_stays_text_in_the_font_of_the_page() -> None:
    svg = svg_text(drawn())
    assert svg.count("font-family") == 1
    assert "'DejaVu Sans',Verdana" in svg
    assert f">{TIP}</text>" in svg
    assert "font-weight: 700" in svg


def test_it_scales_and_has_no_date_no_name_and_no_long_numbers() -> None:
    svg = svg_text(drawn())
    assert svg.startswith('<svg xmlns="http://www.w3.org/2000/svg" width="200pt" height="100pt" ')
    assert 'viewBox="0 0 200 100"' in svg
    for word in ("metadata", "Matplotlib", "DOCTYPE", "<g", "<style"):
        assert word not in svg
    assert not [
        one
        for one in elements(svg)
        if any(len(part.partition(".")[2]) > 2 for part in one.attrib.get("d", "").split())
    ]


def test_missing_data_are_hatched_by_a_pattern() -> None:
    root = ElementTree.fromstring(svg_text(drawn()))
    (pattern,) = root.iter("{http://www.w3.org/2000/svg}pattern")
    assert f"fill: url(#{pattern.attrib['id']})" in svg_text(drawn())


def test_dots_are_squares_of_their_size_on_any_scale() -> None:
    with styled():
        figure = new_figure(100, 100)
        axes = panel(figure, 0, 0, 100, 100)
        axes.set_axis_off()
        axes.set_xlim(0, 10)
        axes.set_ylim(1, 1000)
        axes.set_yscale("log")
        dots(axes, [1, np.nan, 5], [10, 10, 100], 2.0, "#000000", "dots")
    (path,) = [
        one.attrib["d"]
        for one in elements(svg_text(figure))
        if one.attrib.get("d", "").count("M") == 2
    ]
    numbers = np.array([float(part) for part in path.split() if part not in "MLz"]).reshape(
        2, -1, 2
    )
    assert np.ptp(numbers, axis=1) == pytest.approx(2, abs=0.02)
    assert numbers.mean(axis=1)[:, 0] == pytest.approx([10, 50], abs=0.5)


def test_the_same_figure_gives_the_same_bytes_whatever_the_user_has_set(tmp_path: Path) -> None:
    (tmp_path / "matplotlibrc").write_text(
        "font.family: serif\naxes.grid: False\nsvg.fonttype: path\nfont.size: 20\n"
    )
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import test_canvas as t;"
        " print(t.svg_text(t.drawn()))"
    )
    other = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert other.stdout.strip() == svg_text(drawn()).strip()
    assert other.stderr == ""
