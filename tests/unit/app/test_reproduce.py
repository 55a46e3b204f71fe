"""A run is compared with what its capture gives."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pytest

from jbclog.app.reproduce import MOST_SHOWN, compare_from_capture
from jbclog.core.errors import UsageError
from jbclog.record.check import check
from jbclog.record.manifest import Lost, read_manifest, write_manifest
from jbclog.session.run.task import StationTask
from support.invoked import invoked
from support.product import cut_capture, measure_less
from support.records.few_rows import rewritten, with_cell
from support.virtual.recorded_run import run_in
from support.virtual.virtual_run import line_text

FAULT = "[[station.sim.fault]]\nkind = "
TROUBLE = (
    f'{FAULT}"flip"\nbits = 1\nat_s = 3\nfor_s = 4\nevery = 3\n'
    f'{FAULT}"dropout"\nat_s = 6\nfor_s = 2'
)
TABLES = ("samples", "events", "settings", "counters")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two stations with corrupt frames and an outage on each."""
    line = line_text(TROUBLE)
    second = line.replace("dde-1", "dde-2").partition("[[station]]")[2]
    home = tmp_path_factory.mktemp("captured")
    return run_in(home, f"{line}\n[[station]]{second}", duration_s=10.0, wire=True)


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / made.name))


def test_a_run_with_faults_agrees(run: Path) -> None:
    assert check(run) == []
    comparison = compare_from_capture(run)
    assert comparison.differences == comparison.uncompared == comparison.notes == []
    for table in TABLES:
        compared, recorded = comparison.compared[table]
        assert compared == recorded > 0


def changed_cell(column: str, value: object) -> Callable[[pa.Table], pa.Table]:
    def change(table: pa.Table) -> pa.Table:
        stations = table["station"].to_pylist()
        return with_cell(table, stations.index("dde-2"), column, value)

    return change


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [
        ("samples", "temperature_c", 7),
        ("samples", "late_us", 1_234_567),
        ("settings", "readback", "77"),
        ("counters", "value", 7.5),
        ("events", "text", "Nothing."),
    ],
)
def test_a_row_that_was_changed_is_reported(
    run: Path, table: str, column: str, value: object
) -> None:
    rewritten(run, table, changed_cell(column, value))
    (difference,) = compare_from_capture(run).differences
    assert difference.startswith(f"{table}, dde-2, row 0: {column} ")
    assert difference.endswith(f" instead of {value!r}")


def test_moments_and_what_the_recorder_noted_itself_are_not_compared(run: Path) -> None:
    def later(table: pa.Table) -> pa.Table:
        place = table.schema.get_field_index("time")
        kind = table.schema.field("time").type
        moved = pc.add(table["time"].cast(pa.int64()), 5000).cast(kind)
        return table.set_column(place, table.schema.field("time"), moved)

    for table in TABLES:
        rewritten(run, table, later)
    assert compare_from_capture(run).differences == []


def test_a_row_too_many_is_reported(run: Path) -> None:
    rewritten(run, "counters", lambda table: table[:-1])
    (difference,) = compare_from_capture(run).differences
    assert difference == "counters, dde-2: 28 rows instead of 27"


def test_the_first_of_many_differences_are_shown(run: Path) -> None:
    def colder(table: pa.Table) -> pa.Table:
        place = table.schema.get_field_index("temperature_c")
        return table.set_column(
            place,
            table.schema.field("temperature_c"),
            pc.subtract(table["temperature_c"], 1),
        )

    rewritten(run, "samples", colder)
    differences = compare_from_capture(run).differences
    assert len(differences) == 2 * (MOST_SHOWN + 1)
    assert differences[MOST_SHOWN].endswith("more rows differ")


def test_facts_that_differ_are_reported(run: Path) -> None:
    manifest = read_manifest(run)
    manifest.stations[0] = replace(manifest.stations[0], outages=5)
    write_manifest(run, manifest)
    assert compare_from_capture(run).differences == ["manifest, dde-1: outages 1 instead of 5"]


def test_a_session_that_asks_something_else_is_reported(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measure_less(monkeypatch)
    comparison = compare_from_capture(run)
    left = [text for text in comparison.differences if "this version acts differently" in text]
    assert [text[:5] for text in left] == ["dde-1", "dde-2"]


# -- a capture that is not whole -------------------------------------------------------------------


def test_a_capture_that_was_cut_says_what_is_not_compared(run: Path) -> None:
    cut_capture(run, "dde-1", 0.7)
    comparison = compare_from_capture(run)
    assert comparison.differences == []
    assert all("the capture ends" in text for text in comparison.notes)
    compared, recorded = comparison.compared["samples"]
    assert 0 < compared < recorded
    assert any(
        text.startswith("samples, dde-2: only ") and text.endswith(" rows could be compared")
        for text in comparison.uncompared
    )


def test_of_a_run_that_was_cut_off_what_the_capture_has_is_enough(run: Path) -> None:
    cut_capture(run, "dde-1", 0.7)
    manifest = read_manifest(run)
    manifest.lost = Lost(None, "The recorder was killed.")
    write_manifest(run, manifest)
    comparison = compare_from_capture(run)
    assert comparison.differences == comparison.uncompared == []
    assert len(comparison.notes) == 1


def test_a_row_that_is_missing_in_the_capture_ends_the_comparison_there(run: Path) -> None:
    rewritten(run, "wire", lambda table: pa.concat_tables([table[:2000], table[2001:]]))
    comparison = compare_from_capture(run)
    assert comparison.differences == []
    assert 0 < comparison.compared["samples"][0] < comparison.compared["samples"][1]
    assert comparison.uncompared


def test_a_station_without_a_capture_is_named(run: Path) -> None:
    rewritten(run, "wire", lambda table: table.filter(pc.not_equal(table["what"], "run"))[:0])
    with pytest.raises(UsageError, match="only a run recorded with --capture"):
        compare_from_capture(run)


# -- the command -----------------------------------------------------------------------------------


def test_the_command_says_what_was_compared(run: Path) -> None:
    ended = invoked("check", run, "--from-capture")
    assert ended.exit_code == 0, ended.output
    first, last = ended.stdout.splitlines()
    assert first.startswith("compared from the capture: ")
    assert last.startswith(f"{run}: no differences (fingerprint ")
    as_json = json.loads(invoked("check", run, "--from-capture", "--json").stdout)
    assert as_json["agrees"]
    shares = as_json["compared"]["samples"]
    assert shares["rows"] == shares["recorded"] > 0


def test_the_command_finds_a_session_that_acts_differently(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measure_less(monkeypatch)
    ended = invoked("check", run, "--from-capture")
    assert ended.exit_code == 1
    assert "wire/: dde-1: left the capture" in ended.stdout


def test_other_findings_come_first(run: Path) -> None:
    rewritten(run, "samples", changed_cell("temperature_c", 7))
    ended = invoked("check", run, "--from-capture")
    assert ended.exit_code == 1
    assert "not reproduced from the capture" in ended.stdout


# -- what a session is given -----------------------------------------------------------------------


def test_what_a_session_is_ordered_is_in_line_file_recipe_and_capture() -> None:
    """A new field of the task must be stored in the capture's `Head`, and given back by
    `CapturedRun.task`.
    """
    of_line = {"name", "family", "model", "line", "address", "ports", "rated_power_w"}
    of_recipe, of_program = {"recipe"}, {"families", "sharers"}
    of_head = {
        *("url", "recipe_file", "t0", "duration_s", "rate", "allow_omega_write"),
        "may_be_missing",
    }
    known = of_line | of_recipe | of_program | of_head
    assert {field.name for field in fields(StationTask)} == known
