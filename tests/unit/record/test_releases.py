"""Records of earlier releases stay readable for ever: one sealed and one cut off, as each release
left them.

docs/reference/faults.md, F-44.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
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
def test_a_run_that_was_cut_off_is_recovered(release: str, tmp_path: Path) -> None:
    folder = copy_of(release, "open", tmp_path)
    assert recover(folder).outcome is Outcome.RECOVERED
    assert check(folder) == []
    assert len(open_run(folder).samples()) == SECONDS * 10 * 3
