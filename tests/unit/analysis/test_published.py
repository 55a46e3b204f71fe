"""A published tree reads like the folder of its runs, in a folder and in S3; four other readers
read it as docs/how-to/publish.md shows.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import pytest

import jbclog
from jbclog.analysis.trend import trends
from jbclog.app.publish import differences, publish
from jbclog.core.errors import RecordError, UsageError
from jbclog.record.annotations import append
from jbclog.record.published import Tree, key_of
from jbclog.record.schema import constant
from jbclog.report.write import write_report
from support.faults.s3_server import BUCKET, SECRET, Server, serving
from support.invoked import invoked
from support.readers.texts import ROOT, blocks
from support.records.many_runs import ROWS, many_runs, one_run, told

RUNS = 4
PLACES = ("folder", "s3")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs")
    many_runs(out, [0.2, 0.9, -0.4], metadata=told(order="88123", tips=["T-1"]))
    last = one_run(out, RUNS - 1)
    append(last, who="A. Rossi", what="SN-0012", why="read too late", kind="unit.late")
    write_report(last)
    return out


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with serving() as server, pytest.MonkeyPatch.context() as patch:
        for name, value in server.environment.items():
            patch.setenv(name, value)
        yield server


@pytest.fixture(scope="module", params=PLACES)
def table(
    request: pytest.FixtureRequest, home: Path, tmp_path_factory: pytest.TempPathFactory
) -> str:
    """A published tree, with what an interrupted publisher left of another run."""
    if request.param == "s3":
        request.getfixturevalue("server")
        place = f"s3://{BUCKET}/soldering"
    else:
        place = str(tmp_path_factory.mktemp("plant") / "tree")
    tree = Tree.at(place)
    for run in sorted(home.iterdir()):
        publish(run, tree)
    part = (min(home.iterdir()) / "samples" / "part-0000.parquet").read_bytes()
    tree.put(key_of("20260922T060000Z-bench-zzaa", "samples/part-0000.parquet"), [part])
    return place


def facts(*words: object) -> Any:
    ended = invoked(*words, "--json")
    assert ended.exit_code == 0, ended.output
    return json.loads(ended.stdout)


def test_the_same_runs_with_the_same_facts(home: Path, table: str) -> None:
    here, there = jbclog.open_runs(home), jbclog.open_runs(table)
    assert len(there) == RUNS
    pd.testing.assert_frame_equal(
        there.manifests().drop(columns="folder"), here.manifests().drop(columns="folder")
    )
    assert [run.manifest for run in there] == [run.manifest for run in here]
    assert there[0].place == f"{table}/{here[0].name}" == there.manifests()["folder"][0]


@pytest.mark.parametrize(
    "wanted",
    [
        {"order": "88123"},
        {"unit": "SN-0012"},
        {"line": "bench", "since": "2026-09-21T07:30", "until": "2026-09-21T08:30"},
        {"line": "other"},
        {"since": "2026-10-01", "until": "2026-11-01"},
        {"station": "dde-1", "recipe": "sn100c-tht@7"},
    ],
)
def test_filters_find_the_same(home: Path, table: str, wanted: dict[str, str]) -> None:
    names = [run.name for run in jbclog.open_runs(home, **wanted)]
    assert [run.name for run in jbclog.open_runs(table, **wanted)] == names


def test_tables_metrics_and_joints_are_the_same(home: Path, table: str) -> None:
    here, there = jbclog.open_runs(home), jbclog.open_runs(table)
    for name in (
        "samples",
        "events",
        "settings",
        "counters",
        "joints",
        "metrics",
        "alarms",
        "units",
    ):
        pd.testing.assert_frame_equal(getattr(there, name)(), getattr(here, name)())
        pd.testing.assert_frame_equal(getattr(there[0], name)(), getattr(here[0], name)())
    wanted = {"columns": ["tick", "temperature_c"], "start": "2026-09-21T14:13:25", "port": 1}
    pd.testing.assert_frame_equal(there[0].samples(**wanted), here[0].samples(**wanted))
    assert there[0].alarms().equals(here[0].alarms())
    with pytest.raises(UsageError, match="no station"):
        there[0].samples("dde-9")


def test_annotations_are_those_of_the_run(home: Path, table: str) -> None:
    assert list(jbclog.open_runs(table)[-1].units()["unit"]) == ["SN-0012"]


@pytest.mark.parametrize("metric", ["idle_error_c", "recovery_s"])
def test_the_same_trend_and_chart(home: Path, table: str, metric: str) -> None:
    here, there = (trends(jbclog.open_runs(folder), metric) for folder in (home, table))
    assert [one.points for one in here] != []
    assert [one.points for one in there] == [one.points for one in here]
    for verb, part in (("trend", "trends"), ("chart", "charts")):
        found = [facts(verb, folder, "--metric", metric)[part] for folder in (home, table)]
        assert found[0] == found[1]
    name = min(path.name for path in home.iterdir())
    of_run = [facts("chart", f"{folder}/{name}")["charts"] for folder in (home, table)]
    assert of_run[0] == of_run[1]


def test_the_same_list(home: Path, table: str) -> None:
    here, there = (invoked("runs", folder).stdout for folder in (home, table))
    assert there.replace(table, "") == here.replace(str(home), "")
    assert len(there.splitlines()) == RUNS + 1


def test_the_same_comparison(home: Path, table: str) -> None:
    names = sorted(path.name for path in home.iterdir())[:2]
    here, there = (
        facts("compare", *(f"{folder}/{name}" for name in names)) for folder in (home, table)
    )
    assert (there.pop("first"), there.pop("second")) == tuple(f"{table}/{name}" for name in names)
    assert [here.pop("first"), here.pop("second")] != []
    assert there == here


def test_check_and_export_take_a_published_run(home: Path, table: str, tmp_path: Path) -> None:
    for run in sorted(home.iterdir())[::3]:  # the last has a report
        here, there = (facts("check", f"{folder}/{run.name}") for folder in (home, table))
        assert there["agrees"]
        assert there["head"] == here["head"]
        assert (there["run"], there["folder"]) == (run.name, f"{table}/{run.name}")
        ended = [
            invoked("export", f"{place}/{run.name}", "--to", "csv", "--out", tmp_path / out)
            for place, out in ((home, "here"), (table, "there"))
        ]
        assert [one.exit_code for one in ended] == [0, 0], ended[1].output
        assert [path.read_bytes() for path in sorted((tmp_path / "there").iterdir())] == [
            path.read_bytes() for path in sorted((tmp_path / "here").iterdir())
        ]
        shutil.rmtree(tmp_path / "here")
        shutil.rmtree(tmp_path / "there")


def test_publishing_again_and_check_say_so(home: Path, table: str) -> None:
    run = max(home.iterdir())
    assert publish(run, Tree.at(table)).files == 0
    assert differences(run, Tree.at(table)) == []


def test_a_run_that_is_not_published_is_an_error(table: str) -> None:
    with pytest.raises(RecordError, match="is not published there"):
        jbclog.open_run(f"{table}/20260101T000000Z-bench-aaaa")
    with pytest.raises(RecordError, match="is not published there"):  # its manifest is missing
        jbclog.open_run(f"{table}/20260922T060000Z-bench-zzaa")


def test_only_the_row_groups_that_are_needed_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = one_run(tmp_path / "runs", 0)
    publish(run, Tree.at(tmp_path / "plant"))
    opened = jbclog.open_run(tmp_path / "plant" / run.name)
    read: list[int] = []
    read_row_group = pq.ParquetFile.read_row_group
    monkeypatch.setattr(
        pq.ParquetFile,
        "read_row_group",
        lambda self, index, *which, **how: (
            read.append(index) or read_row_group(self, index, *which, **how)
        ),
    )
    last = opened.samples()["time"].max()
    assert read == [0]
    assert opened.samples(start=last + pd.Timedelta("1s")).empty
    assert opened.samples(stop="2020-01-01").empty
    assert read == [0]


@pytest.mark.parametrize("change", ["flipped", "shorter", "missing"])
def test_a_published_part_that_was_changed_is_an_error(tmp_path: Path, change: str) -> None:
    run = one_run(tmp_path / "runs", 0)
    publish(run, Tree.at(tmp_path / "plant"))
    part = tmp_path / "plant" / key_of(run.name, "samples/part-0000.parquet")
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    if change == "missing":
        part.unlink()
    else:
        part.write_bytes(data if change == "flipped" else data[:-1])
    opened = jbclog.open_run(tmp_path / "plant" / run.name)
    assert len(opened.events()) == len(jbclog.open_run(run).events())
    with pytest.raises(RecordError, match=str(part)):
        opened.samples()
    ended = invoked("check", tmp_path / "plant" / run.name)
    assert ended.exit_code == (4 if change == "missing" else 1)


def test_a_part_in_s3_with_a_flipped_bit_is_an_error(server: Server, tmp_path: Path) -> None:
    """Its pages have checksums."""
    run = one_run(tmp_path / "runs", 0)
    tree = Tree.at(f"s3://{BUCKET}/flipped")
    publish(run, tree)
    key = key_of(run.name, "samples/part-0000.parquet")
    data = bytearray(tree.read(key) or b"")
    data[1000] ^= 1
    tree.put(key, [bytes(data)])
    with pytest.raises(RecordError, match=tree.url):
        jbclog.open_run(f"{tree}/{run.name}").samples()


# -- servers ---------------------------------------------------------------------------------------


def test_a_server_that_does_not_answer_is_one_line(
    monkeypatch: pytest.MonkeyPatch, home: Path
) -> None:
    for name, value in Server(1).environment.items():  # nothing listens there
        monkeypatch.setenv(name, value)
    for words in (
        ["runs", "s3://elsewhere/soldering"],
        ["publish", min(home.iterdir()), "s3://elsewhere/soldering"],
    ):
        ended = invoked(*words)
        assert ended.exit_code == 4
        (line,) = ended.stderr.splitlines()
        assert "s3://elsewhere/soldering: " in line


def test_refused_credentials_are_one_line_without_them(
    monkeypatch: pytest.MonkeyPatch, home: Path
) -> None:
    with serving(free_calls=1) as server:
        for name, value in server.environment.items():
            monkeypatch.setenv(name, value)
        ended = invoked("runs", f"s3://{BUCKET}/refused")
    assert ended.exit_code == 4
    (line,) = ended.stderr.splitlines()
    assert "credentials come from the environment" in line
    assert SECRET not in line


# -- other readers ---------------------------------------------------------------------------------

PAGE = (ROOT / "docs" / "how-to" / "publish.md").read_text(encoding="utf-8")
BLOCKS: dict[str, list[str]] = defaultdict(list)
for _block in blocks("python", PAGE):
    BLOCKS[_block.split()[1]].append(_block)


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tree of two lines: two runs in two months of one, a run of the other."""
    out = tmp_path_factory.mktemp("runs")
    tree = Tree.at(tmp_path_factory.mktemp("plant") / "tree")
    names = (
        "20261121T013000Z-bench-3-aaaa",
        "20261201T013000Z-bench-3-aaab",
        "20261121T013000Z-bench-4-aaaa",
    )
    for number, name in enumerate(names):
        publish(one_run(out, number, run=name), tree)
    return Path(tree.url)


def executed(block: str, plant: Path) -> dict[str, Any]:
    """What a block of the page leaves in its variables."""
    found: dict[str, Any] = {}
    exec(block.replace("/data/plant", str(plant)), found)
    return found


def expected(plant: Path, *months: str) -> pd.DataFrame:
    runs = [run for run in jbclog.open_runs(plant) if "bench-3" in run.name]
    frames = [run.samples(columns=["time", "temperature_c"]) for run in runs]
    assert len(frames) == 2
    return pd.concat(frames[: len(months) or None], ignore_index=True)


@pytest.mark.parametrize("reader", ["pyarrow.dataset", "pandas", "polars", "duckdb"])
def test_four_readers_read_the_tree_in_four_lines(plant: Path, reader: str) -> None:
    (block, *_) = BLOCKS[reader]
    assert len([line for line in block.splitlines() if line]) <= 4
    rows = executed(block, plant)["rows"]
    if reader == "duckdb":
        rows = rows.to_arrow_table()
    table = rows if isinstance(rows, pd.DataFrame) else rows.to_pandas()
    table = table.sort_values(["time", "temperature_c"], ignore_index=True)
    right = expected(plant, "2026-11") if reader == "pandas" else expected(plant)
    right = right.sort_values(["time", "temperature_c"], ignore_index=True)
    assert table["temperature_c"].tolist() == right["temperature_c"].tolist()
    moments = pd.to_datetime(table["time"], utc=True).dt.as_unit("us")
    assert moments.tolist() == right["time"].tolist()


def test_duckdb_counts_only_published_runs(plant: Path) -> None:
    name = "20261122T013000Z-bench-3-zzzz"
    half = key_of(name, "samples/part-0000.parquet")
    source = plant / key_of("20261121T013000Z-bench-3-aaaa", "samples/part-0000.parquet")
    rows = pq.ParquetFile(source).read()
    pq.write_table(rows.set_column(0, "run", constant(name, len(rows))), plant / half)
    try:
        (_, block) = BLOCKS["duckdb"]
        counted = executed(block, plant)["rows"].fetchall()
    finally:
        (plant / half).unlink()
    assert sorted(counted) == [(run.name, ROWS) for run in sorted(jbclog.open_runs(plant), key=str)]


def test_a_reader_reads_the_tree_in_s3(server: Server, home: Path) -> None:
    tree = Tree.at(f"s3://{BUCKET}/readers")
    for run in home.iterdir():
        publish(run, tree)
    dataset = ds.dataset("samples", filesystem=tree.files(), format="parquet", partitioning="hive")
    assert {"line", "month"} <= {*dataset.schema.names}
    assert dataset.count_rows(filter=ds.field("line") == "bench") == RUNS * ROWS
    assert dataset.count_rows(filter=ds.field("line") == "other") == 0


def test_the_snippet_of_processes_runs(plant: Path, tmp_path: Path) -> None:
    (block,) = BLOCKS["jbclog"]
    script = tmp_path / "hottest.py"
    script.write_text(block.replace("/data/plant", str(plant)))
    done = subprocess.run(
        [sys.executable, "-W", "error", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()] == [
        run.name for run in jbclog.open_runs(plant, line="bench-3")
    ]
