"""CSV exports as Python's csv module, pandas and DuckDB read them."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pandas as pd
import pytest

import jbclog
from jbclog.app.export import csv_files
from jbclog.app.export.source import SCHEMA_OF, Source
from jbclog.record.manifest import manifest_sha256
from support.lazy import duckdb
from support.records.sealed_run import NAME

from .conftest import FORMULAS


@pytest.fixture(scope="module")
def folder(source: Source, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("csv") / "out"
    csv_files.write(source, out)
    return out


def read(folder: Path, table: str) -> list[dict[str, str]]:
    with (folder / f"{table}.csv").open(encoding="utf-8-sig", newline="") as file:
        return [*csv.DictReader(file, strict=True)]


def test_pandas_reads_every_cell_of_the_samples(folder: Path, run: jbclog.Run) -> None:
    expected = run.samples()
    found = pd.read_csv(
        folder / "samples.csv", parse_dates=["time"], dtype_backend="numpy_nullable"
    )
    assert list(found) == list(expected)
    assert (found["time"] == expected["time"]).all()
    for name in expected:
        assert found[name].isna().tolist() == expected[name].isna().tolist(), name
        is_known = expected[name].notna().to_numpy()
        if name != "time":
            assert found[name][is_known].tolist() == expected[name][is_known].tolist(), name


def test_what_was_not_read_is_empty_and_its_reason_stands_beside_it(folder: Path) -> None:
    lost = read(folder, "samples")[310]
    assert (lost["temperature_c"], lost["quality"]) == ("", "disconnected")
    assert "temperature_c=disconnected" in lost["reasons"]
    assert read(folder, "counters")[0] == {
        "run": NAME,
        "seq": "0",
        "time": "2026-09-21T14:13:21.000000Z",
        "station": "dde-1",
        "port": "",
        "counter": "plugged_min",
        "value": "",
        "uom": "min",
        "raw": "<timeout>",
    }


def test_duckdb_reads_times_as_the_moments_that_they_are(folder: Path, run: jbclog.Run) -> None:
    query = (
        "SELECT epoch_us(start), peak_permille, unit"
        f" FROM read_csv('{folder}/joints.csv', nullstr='') ORDER BY station, port, joint"
    )
    found = duckdb.connect().execute(query).fetchall()
    joints = run.joints()
    assert [row[0] for row in found] == joints["start"].astype("int64").tolist()
    assert [row[1] for row in found] == joints["peak_permille"].tolist()
    assert {row[2] is None for row in found} == {True, False}


@pytest.mark.parametrize("table", SCHEMA_OF)
def test_lines_are_those_of_rfc_4180(folder: Path, table: str) -> None:
    data = (folder / f"{table}.csv").read_bytes()
    assert data.startswith(b"\xef\xbb\xbf")
    assert data.count(b"\n") == data.count(b"\r\n") == len(read(folder, table)) + 1


def test_no_text_is_a_formula(folder: Path) -> None:
    texts = [row["text"] for row in read(folder, "events")]
    assert len(texts) > len(FORMULAS)
    assert all(text.startswith("'") for text in texts[: len(FORMULAS)])


def test_the_metadata_name_the_run_its_fingerprint_and_the_units(
    folder: Path, run: jbclog.Run
) -> None:
    found = json.loads((folder / csv_files.METADATA).read_text())
    facts = {one["schema:name"]: one["schema:value"] for one in found["schema:additionalProperty"]}
    assert facts["run"] == run.name
    # and not what a tag of this name says
    assert facts["fingerprint"] == manifest_sha256(run.folder)
    assert facts["tag fingerprint"] == "forged"
    assert "released" in facts["note 1"]
    assert found["dc:title"] == f"exported by jbclog {jbclog.__version__} from run {run.name}"
    columns = {
        one["url"]: {column["name"]: column for column in one["tableSchema"]["columns"]}
        for one in found["tables"]
    }
    assert columns["samples.csv"]["temperature_c"]["schema:unitText"] == "°C"
    assert columns["alarms.csv"]["peak_c"]["schema:unitText"] == "°C"
    assert columns["joints.csv"]["start"]["datatype"] == "dateTimeStamp"


def test_only_the_tables_that_were_chosen(run: jbclog.Run, place: Path) -> None:
    assert csv_files.write(Source(run, ["joints", "samples"], is_checked=True), place).keys() == {
        "samples",
        "joints",
    }
    assert {path.name for path in place.iterdir()} == {
        "samples.csv",
        "joints.csv",
        csv_files.METADATA,
    }


def test_a_table_written_in_shares_is_the_same(
    folder: Path, source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_files, "ROWS_AT_ONCE", 100)
    csv_files.write(source, tmp_path / "out")
    for path in folder.iterdir():
        assert (tmp_path / "out" / path.name).read_bytes() == path.read_bytes()
