"""The report's tables as CSV: what is in them, and that no text becomes a formula."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from jbclog.core.text import clean, csv_cell
from jbclog.report.spreadsheet import TABLES
from jbclog.report.write import write_report
from support.records.sealed_run import alarm, samples, seal, station, table
from support.records.small_run import make_run


def rows(run: Path, name: str) -> list[dict[str, str]]:
    text = (run / "tables" / f"{name}.csv").read_bytes().decode("utf-8-sig")
    return list(csv.DictReader(text.splitlines(keepends=True)))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = make_run(tmp_path_factory.mktemp("runs"), 120)
    write_report(folder)
    return folder


def test_every_table_is_there_with_its_columns(run: Path) -> None:
    for name, columns in TABLES.items():
        found = rows(run, name)
        # nobody named a unit, and nothing need go wrong
        assert found or name in ("alarms", "units"), name
        head = (run / "tables" / f"{name}.csv").read_text("utf-8-sig").splitlines()[0].split(",")
        assert head[: len(columns)] == list(columns)
        # as many cells as titles
        assert all(None not in row and None not in row.values() for row in found)


def test_a_rule_has_its_figure_and_its_bound_as_numbers(tmp_path: Path) -> None:
    run = seal(tmp_path, [station(rows=3200)], table(samples(3200, joints_until_s=5.0)))
    write_report(run)
    rule = next(row for row in rows(run, "rules") if row["name"] == "idle_error")
    assert rule["result"] == "pass"
    assert float(rule["bound_low"]) < float(rule["observed"]) < float(rule["bound_high"])
    assert float(rule["n_effective"]) <= int(rule["n"])
    coverage = next(row for row in rows(run, "rules") if row["name"] == "coverage")
    assert (coverage["bound_low"], coverage["bound_high"]) == ("", "")


def test_the_ledger_adds_up(run: Path) -> None:
    for row in rows(run, "ledger"):
        reasons = [int(row[name] or 0) for name in list(row)[5:]]
        assert int(row["due"]) == int(row["ok"]) + sum(reasons)


FORMULAS = ["=1+1", "+1", "-1+1", "@SUM(A1)", "\t=1", "\r=1", " =1", "＝1+1"]


def test_no_text_is_a_formula(tmp_path: Path) -> None:
    alarms = [alarm(12 + number, text=text) for number, text in enumerate(FORMULAS)]
    folder = seal(tmp_path, [station(rows=300)], table(samples(300)), alarms)
    write_report(folder)
    assert [event["text"] for event in rows(folder, "events")] == [
        csv_cell(text) for text in FORMULAS
    ]
    assert [csv_cell(text) for text in FORMULAS] == [f"'{clean(text)}" for text in FORMULAS]


@pytest.mark.parametrize("value", [-1.5, 3, None, "dde-1", "350", ""])
def test_numbers_and_plain_words_stay_what_they_are(value: object) -> None:
    assert csv_cell(value) == value
