"""Sealed runs of 0.1.0 and of a checkout after it open with every reading command.

docs/reference/faults.md, F-44.
"""

from __future__ import annotations

import json
import shutil
import warnings
from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
from jbclog.core.errors import RecordError
from jbclog.record.annotations import read
from jbclog.record.check import check
from jbclog.record.recover import Outcome, recover
from jbclog.report.write import write_report
from support.invoked import invoked
from support.records.release_corpus import HOME, SECONDS, TABLES, noted

RELEASES = sorted(path.name for path in HOME.iterdir())
every_release = pytest.mark.parametrize("release", RELEASES)


def copy_of(release: str, kind: str, tmp_path: Path) -> Path:
    (run,) = (HOME / release / kind).iterdir()
    return Path(shutil.copytree(run, tmp_path / run.name))


def test_there_are_some() -> None:
    assert {"0.1.0", "after-0.1.0"} <= set(RELEASES)


@every_release
def test_a_sealed_run_says_what_it_said(release: str, tmp_path: Path) -> None:
    folder = copy_of(release, "sealed", tmp_path)
    said = json.loads((HOME / release / "noted.json").read_text())
    assert noted(folder) == said
    run = open_run(folder)
    assert {table: len(getattr(run, table)()) for table in TABLES} == {
        table: said[table]["rows"] for table in TABLES
    }
    names = sorted(one.name for one in run.manifest.stations)
    assert (run.manifest.verdict, run.manifest.exit_code, names) == (
        "REJECT",
        1,
        ["ale-1", "dde-1"],
    )
    tip = run.samples(station="dde-1", port=1)["temperature_c"]
    assert (
        tip.notna().sum()
        == run.manifest.ledger["dde-1"]["1"]["temperature_c"]["ok"]
        == SECONDS * 10
    )


@every_release
def test_a_sealed_run_agrees_and_gives_a_report(release: str, tmp_path: Path) -> None:
    folder = copy_of(release, "sealed", tmp_path)
    assert check(folder) == []
    # which holds its verdict against its record, too
    assert invoked("check", folder).exit_code == 0
    assert recover(folder).outcome is Outcome.WHOLE
    assert write_report(folder).is_file()
    assert check(folder) == []
    assert [one.who for one in read(folder).said] == ([] if release == "0.1.0" else ["A. Rossi"])


@every_release
def test_an_open_run_is_left_to_the_version_that_made_it(release: str, tmp_path: Path) -> None:
    folder = copy_of(release, "sealed", tmp_path)
    (folder / "live.sqlite").write_bytes(b"SQLite format 3\0")
    with pytest.raises(RecordError, match=r"an open run of jbclog 0\.1\.0"):
        recover(folder)


READING = {
    "check": (("check", "{run}"), 0),
    "report": (("report", "{run}"), 0),
    "runs": (("runs", "{runs}"), 0),
    "compare": (("compare", "{run}", "{run}"), 0),
    "alarms": (("alarms", "{run}"), 1),
    "chart of a run": (("chart", "{run}", "--metric", "depth_c"), 0),
    "chart of runs": (("chart", "{runs}", "--metric", "idle_error_c"), 0),
    "trend": (("trend", "{runs}", "--metric", "idle_error_c"), 0),
    "limits": (("limits", "learn", "{run}", "--out", "{runs}/limits.json"), 1),
    "where-used": (("where-used", "{runs}", "--station", "dde-1", "--since", "2026-01-01"), 0),
    "export": (("export", "{run}", "--to", "csv", "--out", "{runs}/exported"), 0),
    "annotate": (("annotate", "{run}", "seen", "--by", "A. Rossi", "--reason", "audit"), 0),
    "recover": (("recover", "{runs}"), 0),
    "check from a capture": (("check", "{run}", "--from-capture"), 2),
}
"""Command -> words, and the exit code."""


@pytest.mark.parametrize("verb", READING)
@every_release
def test_every_reading_command_answers(release: str, verb: str, tmp_path: Path) -> None:
    words, code = READING[verb]
    folder = copy_of(release, "sealed", tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ended = invoked(*(word.format(run=folder, runs=tmp_path) for word in words))
    assert ended.exit_code == code, ended.output
    assert ended.output
    assert "internal error" not in ended.output


@every_release
def test_check_says_what_it_does_not_know_of_such_a_run(release: str, tmp_path: Path) -> None:
    said = invoked("check", copy_of(release, "sealed", tmp_path)).output
    assert (
        "verdict: judged by rules 1, which this version does not have; its record is intact" in said
    )
    assert ("manifest.json: has no digest" in said) is (release == "0.1.0")
