"""`bench_growth.py` stores points as they come and does not measure them twice, and its page lists
the curves that are not straight.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

sys.path.insert(0, str(Path(__file__).parents[1]))

import bench_growth
import growth_page
from growth_page import Point

from support.readers.texts import ROOT


def series(*values: float) -> list[Point]:
    return [
        Point("folders", 10.0**number, {"s": value}, "m", "d", "Copies.")
        for number, value in enumerate(values, 1)
    ]


def test_a_line_has_what_is_fixed_and_what_each_adds() -> None:
    line = growth_page.line_of(series(3.0, 12.0, 102.0), "s")
    assert (line.fixed, line.each) == (pytest.approx(2.0), pytest.approx(0.1))
    assert line.departure < 0.001
    assert growth_page.line_of(series(2.0, 2.1, 2.0), "s").departure < 0.05
    assert growth_page.line_of(series(2.0, 20.0, 2000.0), "s").departure > 0.5
    assert growth_page.line_of(series(0.0, 0.0, 0.0), "s") == (0.0, 0.0, 0.0)


def test_the_page_has_a_table_a_picture_and_what_is_not_explained(tmp_path: Path) -> None:
    written = growth_page.write_page(series(2.0, 20.0, 2000.0), ["folders", "rates"], tmp_path)
    assert [path.name for path in written] == ["growth.md", "growth-folders.svg"]
    text = written[0].read_text()
    assert "| runs | 10 | 100 | 1,000 | fixed | each |" in text
    assert re.search(r"^\| s \| 2 \| 20 \| 2e\+03 \| \S+ \| \S+ \|$", text, re.MULTILINE)
    assert re.search(r"^- s: up to \d+ % from its line. Not explained yet.$", text, re.MULTILINE)
    assert "## rates" not in text
    assert written[1].read_text().startswith("<svg")


def test_the_page_is_that_of_the_points_and_explains_each_line() -> None:
    points = bench_growth.measured(bench_growth.HOME / "growth.jsonl")
    page = growth_page.text_of(growth_page.series_of(points, bench_growth.PARTS))
    assert page == (ROOT / "docs" / "reference" / "growth.md").read_text()
    assert growth_page.why("folders", "something new") not in page


def test_points_measured_otherwise_are_named_apart(tmp_path: Path) -> None:
    points = series(2.0, 20.0, 200.0)
    points[0] = points[0]._replace(about="Links.", day="earlier")
    (page, _) = growth_page.write_page(points, ["folders"], tmp_path)
    assert "\nCopies. (d, m) Links. (earlier, m)\n" in page.read_text()


def test_an_interrupted_part_is_resumed_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[int] = []

    def measured(size: int, _: float) -> dict[str, float]:
        tried.append(size)
        if size == 3 and tried.count(3) == 1:
            raise KeyboardInterrupt
        return {"s": float(size)}

    monkeypatch.setattr(
        bench_growth, "PARTS", {"folders": bench_growth.Part((1, 2, 3, 4), (1,), measured)}
    )
    path = tmp_path / "growth.jsonl"
    with pytest.raises(KeyboardInterrupt):
        bench_growth.measure(["folders"], path, tiny=False, again=False, most=9, seconds=1)
    with path.open("a") as file:
        file.write('{"part": "fol')  # and a line that was cut off
    points = bench_growth.measure(["folders"], path, tiny=False, again=False, most=3, seconds=1)
    assert [point.size for point in points] == [1, 2, 3]
    assert tried == [1, 2, 3, 3]
    assert [
        point.size
        for point in bench_growth.measure(
            ["folders"], path, tiny=False, again=True, most=2, seconds=1
        )
    ] == [1, 2]
