"""`Runs.map` in processes and on a real Dask scheduler with two workers: the same figures in the
same order as here, also if one worker is killed in the middle.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

import jbclog
from jbclog.analysis import workers
from jbclog.analysis.trend import trends
from jbclog.analysis.workers import OfRun, Workers
from jbclog.app.publish import publish
from jbclog.core.errors import RecordError, UsageError
from jbclog.record.published import Tree, key_of
from support.faults.dask_cluster import (
    Cluster,
    KilledOnce,
    cluster,
    divided,
    figures_and_process,
    figures_of,
    kills_always,
)
from support.faults.s3_server import BUCKET, serving
from support.invoked import invoked
from support.records.many_runs import many_runs

RUNS = 12
METRIC = "idle_error_c"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs")
    many_runs(out, [number / 10 for number in range(RUNS)])
    return out


@pytest.fixture(scope="module")
def table(home: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("plant") / "tree"
    for run in home.iterdir():
        publish(run, Tree.at(place))
    return place


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A cluster of two workers that no test kills."""
    with cluster(tmp_path_factory.mktemp("cluster"), 2) as found:
        yield found


@pytest.fixture(scope="module")
def here(table: Path) -> list[tuple[str, int, float]]:
    """The figures that this process computes."""
    figures = [result for _, result in jbclog.open_runs(table).map(figures_of)]
    assert [name for name, _, _ in figures] == sorted(name for name, _, _ in figures)
    assert len({mean for _, _, mean in figures}) > RUNS // 2
    return figures


def test_a_worker_killed_in_the_middle_changes_no_figure(
    table: Path, here: list[tuple[str, int, float]], tmp_path: Path
) -> None:
    """Dask gives its tasks to the other one."""
    with cluster(tmp_path, 2) as found:
        runs = jbclog.open_runs(table, scheduler=found.address)
        killed = KilledOnce(here[RUNS // 2][0], tmp_path / "killed")
        results = [result for _, result in runs.map(killed)]
        alive = [process for process in found.processes[1:] if process.is_alive()]
    assert (tmp_path / "killed").exists()
    assert len(alive) == 1
    assert [figures for figures, _ in results] == here
    assert int((tmp_path / "killed").read_text()) not in {process for _, process in results[-2:]}
    assert runs.unreadable == []


def test_both_workers_compute_and_the_order_is_that_of_the_runs(
    table: Path, here: list[tuple[str, int, float]], two: Cluster, tmp_path: Path
) -> None:
    runs = jbclog.open_runs(table, scheduler=two.address)
    (tmp_path / "never").touch()
    results = [*runs.map(KilledOnce(here[0][0], tmp_path / "never"))]
    assert [figures for _, (figures, _) in results] == here
    assert [found.run for found, _ in results] == [name for name, _, _ in here]
    assert len({process for _, (_, process) in results}) == 2


def test_folders_of_runs_too(home: Path, here: list[tuple[str, int, float]], two: Cluster) -> None:
    runs = jbclog.open_runs(home, scheduler=two.address)
    assert [result for _, result in runs.map(figures_of)] == here


def test_the_trend_of_a_table_is_the_same(table: Path, home: Path, two: Cluster) -> None:
    (alone,) = trends(jbclog.open_runs(home), METRIC)
    (spread,) = trends(jbclog.open_runs(table, scheduler=two.address), METRIC)
    assert spread.points == alone.points
    words = ["trend", table, "--metric", METRIC, "--json"]
    ended = [invoked(*words), invoked(*words, "--scheduler", two.address)]
    assert [one.exit_code for one in ended] == [0, 0], ended[1].output
    assert json.loads(ended[0].stdout) == json.loads(ended[1].stdout)


def test_a_table_in_s3(home: Path, here: list[tuple[str, int, float]], tmp_path: Path) -> None:
    """Workers have the credentials in their own environment."""
    with serving() as server, pytest.MonkeyPatch.context() as patch:
        for name, value in server.environment.items():
            patch.setenv(name, value)
        place = f"s3://{BUCKET}/fleet"
        for run in home.iterdir():
            publish(run, Tree.at(place))
        with cluster(tmp_path, 2) as found:
            runs = jbclog.open_runs(place, scheduler=found.address)
            assert [result for _, result in runs.map(figures_of)] == here


def test_processes(table: Path, here: list[tuple[str, int, float]]) -> None:
    results = [*jbclog.open_runs(table, processes=2).map(figures_and_process)]
    assert [figures for _, (figures, _) in results] == here
    (mine,) = {process for _, (_, process) in jbclog.open_runs(table).map(figures_and_process)}
    assert mine not in {process for _, (_, process) in results}


def test_a_killed_process_is_an_error(table: Path) -> None:
    with pytest.raises(RecordError, match="a process that read runs was killed"):
        list(jbclog.open_runs(table, processes=2).map(kills_always))


@pytest.mark.parametrize("where", ["here", "processes", "scheduler"])
def test_a_run_that_cannot_be_read_is_listed_and_the_others_go_on(
    table: Path, here: list[tuple[str, int, float]], two: Cluster, tmp_path: Path, where: str
) -> None:
    place = Path(shutil.copytree(table, tmp_path / "tree"))
    bad = place / key_of(here[1][0], "samples/part-0000.parquet")
    bad.write_bytes(b"x" * bad.stat().st_size)
    at = {"processes": {"processes": 2}, "scheduler": {"scheduler": two.address}}.get(where, {})
    runs = jbclog.open_runs(place, **at)
    assert [result for _, result in runs.map(figures_of)] == [here[0], *here[2:]]
    (one,) = runs.unreadable
    assert one.folder.name == here[1][0]
    assert "was changed" in one.why


@pytest.mark.parametrize("where", ["here", "processes", "scheduler"])
def test_an_error_of_the_function_ends_the_work(table: Path, two: Cluster, where: str) -> None:
    at = {"processes": {"processes": 2}, "scheduler": {"scheduler": two.address}}.get(where, {})
    with pytest.raises(ZeroDivisionError):
        list(jbclog.open_runs(table, **at).map(divided))


def test_a_worker_of_another_version_is_an_error(table: Path, two: Cluster) -> None:
    other = OfRun(figures_of, made_by="jbclog 0.0.1, rules 1, methods 1")
    path = str(next(iter(jbclog.open_runs(table).found)).folder)
    with pytest.raises(UsageError, match=r"here is jbclog 0\.0\.1"):
        list(Workers(scheduler=two.address).map(other, [path]))


def test_workers_that_are_always_killed_are_an_error(
    table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "NO_WORKER_S", 1.0)
    with cluster(tmp_path, 2) as found:
        runs = jbclog.open_runs(table, scheduler=found.address)
        with pytest.raises(RecordError, match=rf"{found.address}: "):
            list(runs.map(kills_always))


def test_a_scheduler_without_workers_or_without_an_answer_is_an_error(
    table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "CONNECT_S", 1.0)
    with cluster(tmp_path, 0) as found, pytest.raises(RecordError, match="has no worker"):
        list(jbclog.open_runs(table, scheduler=found.address).map(figures_of))
    with pytest.raises(RecordError, match="no scheduler answers"):
        list(jbclog.open_runs(table, scheduler="tcp://127.0.0.1:1").map(figures_of))
    ended = invoked("trend", table, "--scheduler", "tcp://127.0.0.1:1")
    assert ended.exit_code == 4
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.parametrize("address", ["127.0.0.1:8786", "http://a:1", "tcp://user@a:1", "tcp://a"])
def test_an_address_that_is_none(table: Path, address: str) -> None:
    with pytest.raises(UsageError, match="a scheduler is tcp://HOST:PORT"):
        jbclog.open_runs(table, scheduler=address)
    assert invoked("trend", table, "--scheduler", address).exit_code == 2
