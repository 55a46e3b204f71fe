"""`jbclog export`: where it writes, what it refuses, and what becomes of runs that are open,
recovered, damaged or annotated.
"""

from __future__ import annotations

import csv
import json
import shutil
import sys
from pathlib import Path

import pytest
from click.testing import Result

import jbclog
from jbclog.app.export import csv_files, qdas
from jbclog.record.annotations import append
from jbclog.record.check import check
from jbclog.record.recover import recover
from support.invoked import invoked
from support.records import alarm_series, few_rows, small_run

FORMATS = ("csv", "xlsx", "mf4", "qdas")


def export(*words: str | Path) -> Result:
    return invoked("export", *words)


def seen(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_run.make_run(tmp_path_factory.mktemp("runs"), 30.0)


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    """A sealed run of its own for each test."""
    return Path(shutil.copytree(made, tmp_path / "runs" / made.name))


def facts_of(folder: Path) -> dict[str, str]:
    listed = json.loads((folder / csv_files.METADATA).read_text())["schema:additionalProperty"]
    return {one["schema:name"]: one["schema:value"] for one in listed}


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        return [*csv.DictReader(file)]


@pytest.mark.parametrize("to", FORMATS)
def test_each_format_beside_the_run_which_stays_as_it_was(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, to: str
) -> None:
    monkeypatch.chdir(tmp_path)
    before = seen(run)
    ended = export(run, "--to", to, "--json")
    assert ended.exit_code == 0, ended.output
    told = json.loads(ended.stdout)
    place = f"{run.name}-{to}" if to in ("csv", "qdas") else f"{run.name}.{to}"
    assert (told["out"], told["checked"]) == (place, True)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([place, "runs"])
    assert told["rows"]["joints"] == len(jbclog.open_run(run).joints()) > 0
    assert seen(run) == before
    assert check(run) == []


@pytest.mark.parametrize("to", FORMATS)
def test_nothing_is_overwritten_without_force(run: Path, tmp_path: Path, to: str) -> None:
    out = tmp_path / "out"
    assert export(run, "--to", to, "--out", out).exit_code == 0
    old = out.stat().st_ino
    again = export(run, "--to", to, "--out", out)
    assert (again.exit_code, out.stat().st_ino) == (2, old)
    assert "--force replaces it" in again.stderr
    assert export(run, "--to", to, "--out", out, "--force").exit_code == 0
    assert out.stat().st_ino != old
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "runs"]


def test_force_replaces_no_folder_with_anything_but_exports(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.odt").write_text("x")
    (out / "old.csv").write_text("x")
    for to in ("csv", "qdas"):
        ended = export(run, "--to", to, "--out", out, "--force")
        assert ended.exit_code == 2
        assert "thesis.odt, which is not an export" in ended.stderr
    assert sorted(seen(out)) == ["old.csv", "thesis.odt"]
    (out / "thesis.odt").unlink()
    assert export(run, "--to", "qdas", "--out", out, "--force").exit_code == 0
    # and no older file between them
    assert sorted(seen(out)) == ["ale-1-port1.dfq", "dde-1-port1.dfq", "dde-1-port2.dfq"]


@pytest.mark.parametrize("place", ["run/x.xlsx", "run/figures", "link/x", "run", ".", "gone/x"])
@pytest.mark.parametrize("to", ["csv", "xlsx"])
def test_never_into_a_run_or_over_it(run: Path, tmp_path: Path, place: str, to: str) -> None:
    (tmp_path / "link").symlink_to(run)
    before = seen(tmp_path)
    out = run.parent if place == "." else tmp_path / place.replace("run", f"runs/{run.name}")
    ended = export(run, "--to", to, "--out", out, "--force")
    assert ended.exit_code == 2, ended.output
    assert seen(tmp_path) == before


def test_a_file_takes_no_folder_and_a_folder_no_file(run: Path, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("x")
    assert (
        "must be a file"
        in export(run, "--to", "mf4", "--out", tmp_path / "folder", "--force").stderr
    )
    assert (
        "must be a folder"
        in export(run, "--to", "csv", "--out", tmp_path / "file", "--force").stderr
    )
    # an empty one is taken
    assert export(run, "--to", "csv", "--out", tmp_path / "folder").exit_code == 0


@pytest.mark.parametrize("to", FORMATS)
def test_a_damaged_run_is_refused_and_tables_that_were_changed_always_are(
    run: Path, tmp_path: Path, to: str
) -> None:
    part = next((run / "samples").iterdir())
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes(data)
    for more in ((), ("--unchecked",)):
        ended = export(run, "--to", to, "--out", tmp_path / "out", *more)
        assert ended.exit_code == 4, ended.output
        assert "samples/" in ended.stderr
        assert "--unchecked" in ended.stderr or more
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_what_the_tables_do_not_rest_on_is_exported_unchecked_and_says_so(
    run: Path, tmp_path: Path
) -> None:
    (run / "notes.txt").write_text("somebody's")
    refused = export(run, "--to", "csv", "--out", tmp_path / "out")
    assert (refused.exit_code, (tmp_path / "out").exists()) == (4, False)
    assert "notes.txt: is not in the manifest" in refused.stderr
    ended = export(run, "--to", "csv", "--out", tmp_path / "out", "--unchecked")
    assert ended.exit_code == 0
    assert "not checked" in ended.stderr
    assert facts_of(tmp_path / "out")["integrity"] == "not checked (--unchecked)"


def test_a_run_that_is_being_recorded(tmp_path: Path) -> None:
    with alarm_series.being_recorded(alarm_series.random_series(1, 100), tmp_path / "runs") as (
        folder,
        _,
    ):
        refused = export(folder, "--to", "csv", "--out", tmp_path / "out")
        assert refused.exit_code == 4
        assert "not sealed" in refused.stderr
        ended = export(folder, "--to", "csv", "--out", tmp_path / "out", "--unchecked")
        assert ended.exit_code == 0, ended.output
    facts = facts_of(tmp_path / "out")
    assert facts["state"].startswith("not sealed")
    assert facts["fingerprint"] == "none: the run is not sealed"
    assert len(rows_of(tmp_path / "out" / "samples.csv")) == 100


def test_a_recovered_run_says_what_it_lost(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path / "runs")
    refused = export(folder, "--to", "mf4", "--out", tmp_path / "out")
    assert (refused.exit_code, "jbclog recover" in refused.stderr) == (4, True)
    recover(folder)
    ended = export(folder, "--to", "csv", "--out", tmp_path / "out")
    assert ended.exit_code == 0, ended.output
    facts = facts_of(tmp_path / "out")
    assert facts["state"] == "recovered"
    assert facts["lost"]
    assert len(rows_of(tmp_path / "out" / "samples.csv")) == 150


def test_annotations_of_a_run_are_exported(run: Path, tmp_path: Path) -> None:
    opened = jbclog.open_run(run)
    episode = opened.alarms()["episode"].iloc[0]
    append(run, who="Q. A.", what=episode, why="tip changed", kind="alarm.acknowledged")
    append(run, who="M. Weber", what="SN-77", why="label was torn", kind="unit.late")
    assert export(run, "--to", "csv", "--out", tmp_path / "out").exit_code == 0
    first = rows_of(tmp_path / "out" / "alarms.csv")[0]
    assert (first["acknowledged_by"], first["acknowledged_why"]) == ("Q. A.", "tip changed")
    facts = facts_of(tmp_path / "out")
    assert facts["units"] == "SN-001, SN-002, SN-77"
    assert "label was torn" in facts["note 2"]


@pytest.mark.parametrize(("to", "library"), [("xlsx", "xlsxwriter"), ("mf4", "asammdf")])
def test_a_library_that_is_missing_is_one_line_with_the_command_that_installs_it(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, to: str, library: str
) -> None:
    for name in [
        name
        for name in sys.modules
        if name.split(".")[0] == library or name.startswith("jbclog.app.export")
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)
    ended = export(run, "--to", to, "--out", tmp_path / "out")
    assert ended.exit_code == 2
    assert ended.stderr.count("\n") == 1
    assert f"`pip install 'jbclog[export]'` installs what --to {to} needs" in ended.stderr


def test_a_table_that_a_format_lacks_is_refused(run: Path, tmp_path: Path) -> None:
    assert (
        "qdas has joints"
        in export(run, "--to", "qdas", "--table", "samples", "--out", tmp_path / "out").stderr
    )
    assert (
        "csv has samples, events"
        in export(run, "--to", "csv", "--table", "jonts", "--out", tmp_path / "out").stderr
    )
    assert export(run, "--to", "csv", "--table", "joints", "--out", tmp_path / "out").exit_code == 0
    assert [*sorted(seen(tmp_path / "out"))] == [csv_files.METADATA, "joints.csv"]


def test_an_interrupted_export_leaves_nothing(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    out = tmp_path / "out"
    assert export(run, "--to", "qdas", "--out", out).exit_code == 0
    before = seen(out)
    monkeypatch.setattr(qdas, "_lines", interrupted)
    assert export(run, "--to", "qdas", "--out", out, "--force").exit_code == 130
    assert seen(out) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "runs"]
