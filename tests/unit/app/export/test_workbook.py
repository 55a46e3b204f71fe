"""Workbooks as openpyxl reads them, and what their XML has."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

import jbclog
from jbclog.app.export import workbook
from jbclog.app.export.source import Source
from jbclog.core.text import csv_cell
from support.lazy import openpyxl

from .conftest import FORMULAS

Cells = list[tuple[object, ...]]


@pytest.fixture(scope="module")
def path(source: Source, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("xlsx") / "run.xlsx"
    workbook.write(source, out)
    return out


def sheets(path: Path) -> dict[str, Cells]:
    book = openpyxl.load_workbook(path, read_only=True)
    try:
        return {sheet.title: [*sheet.iter_rows(values_only=True)] for sheet in book}
    finally:
        book.close()


@pytest.fixture(scope="module")
def read(path: Path) -> dict[str, Cells]:
    return sheets(path)


def test_every_cell_of_the_samples(read: dict[str, Cells], run: jbclog.Run) -> None:
    expected = run.samples()
    expected["time"] = expected["time"].dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    names, *rows = read["samples"]
    assert list(names) == list(expected)
    assert rows == [
        *expected.astype(object).where(expected.notna(), None).itertuples(index=False, name=None)
    ]


def test_times_are_text_in_utc_and_numbers_and_flags_are_no_text(read: dict[str, Cells]) -> None:
    first = dict(zip(*read["samples"][:2], strict=True))
    assert isinstance(first["time"], str)
    assert first["time"].endswith("Z")
    assert isinstance(first["tick"], int)
    assert first["alarm_high"] is False


def test_nothing_is_a_formula_or_a_link(path: Path, read: dict[str, Cells]) -> None:
    with zipfile.ZipFile(path) as parts:
        assert not any("hyperlink" in name for name in parts.namelist())
        written = b"".join(parts.read(name) for name in parts.namelist() if "worksheets" in name)
    assert b"<f>" not in written
    assert b"hyperlink" not in written
    place = read["events"][0].index("text")
    assert [row[place] for row in read["events"][1 : len(FORMULAS) + 1]] == [
        csv_cell(text) for text in FORMULAS
    ]
    assert ("operator", "'=HYPERLINK(1)") in [row[:2] for row in read["about"]]


def test_the_first_sheet_has_facts_units_and_the_sheets_of_each_table(
    read: dict[str, Cells], run: jbclog.Run
) -> None:
    assert [*read] == ["about", "samples", "events", "settings", "counters", "joints", "alarms"]
    rows = read["about"]
    assert rows[0][0] == f"exported by jbclog {jbclog.__version__} from run {run.name}"
    assert ("run", run.name) in [row[:2] for row in rows]
    assert ("samples", "samples", len(run.samples())) in [row[:3] for row in rows]
    assert ("samples", "temperature_c", "°C", "integer") in [row[:4] for row in rows]


def test_more_rows_than_a_sheet_holds_continue_on_further_sheets_which_is_stated(
    source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: jbclog.Run
) -> None:
    monkeypatch.setattr(workbook, "MOST_ROWS", 701)
    rows = workbook.write(source, tmp_path / "run.xlsx")
    read = sheets(tmp_path / "run.xlsx")
    assert [len(read[name]) - 1 for name in ("samples", "samples 2", "samples 3")] == [
        700,
        700,
        400,
    ]
    assert rows["samples"] == 1800
    assert read["samples"][0] == read["samples 2"][0] == read["samples 3"][0]
    place = read["samples"][0].index("tick")
    ticks = [row[place] for name in ("samples", "samples 2", "samples 3") for row in read[name][1:]]
    assert ticks == run.samples()["tick"].tolist()
    assert any("continues on 2 further sheet(s)" in str(row[1]) for row in read["about"])


def test_the_same_run_gives_the_same_bytes(source: Source, path: Path, tmp_path: Path) -> None:
    workbook.write(source, tmp_path / "again.xlsx")
    assert (tmp_path / "again.xlsx").read_bytes() == path.read_bytes()
