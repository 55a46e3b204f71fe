"""Runs of a store on a real Dask scheduler with real workers: the same answers, even if a worker is
killed; a clear error for worse failures.
"""

from __future__ import annotations

import json
import os
import runpy
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pandas as pd
import pytest

import jbclog
from jbclog.analysis.fleet import processes
from jbclog.analysis.fleet.processes import Processes
from jbclog.analysis.fleet.scheduler import Scheduler
from jbclog.analysis.store.place import Place, place_of
from jbclog.analysis.store.runs import StoredRuns
from jbclog.app.publish.folder import publish_all
from jbclog.app.publish.publisher import Publisher
from jbclog.core.errors import RecordError, UsageError
from support.faults.dask_cluster import (
    TLS,
    Cluster,
    certificates,
    cluster,
    divided,
    ends_always,
    killed_at,
    length,
    rows_of,
    slow,
)
from support.invoked import invoked
from support.readers.texts import ROOT
from support.records.many_runs import many_runs

RUNS = 9


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs")
    many_runs(out, [0.1 * number for number in range(RUNS)])
    return out


@pytest.fixture(scope="module")
def place(home: Path, tmp_path_factory: pytest.TempPathFactory) -> Place:
    found = place_of(tmp_path_factory.mktemp("plant") / "store")
    with Publisher(found) as one:
        assert len([*publish_all(one, home)]) == RUNS
    return found


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with cluster(tmp_path_factory.mktemp("fleet"), workers=2) as one:
        yield one


def trend(*words: object, code: int = 0) -> tuple[object, str]:
    ended = invoked("trend", *words, "--json")
    assert ended.exit_code == code, ended.output
    return (json.loads(ended.stdout) if code == 0 else None), ended.stderr


def test_a_trend_is_the_same(place: Place, fleet: Cluster) -> None:
    assert trend(place, "--upper", 4, "--scheduler", fleet.address) == trend(place, "--upper", 4)


def test_statistics_are_the_same_to_the_last_digit(place: Place, fleet: Cluster) -> None:
    runs = jbclog.open_runs(place.url)
    assert isinstance(runs, StoredRuns)
    for what in (
        ("samples", "power_permille", ["run", "port"]),
        ("joints", "recovery_s", ["station"]),
    ):
        pd.testing.assert_frame_equal(
            runs.on(fleet.address).statistics(*what), runs.statistics(*what), check_exact=True
        )


def test_a_function_of_the_user_is_called_by_workers_for_runs_of_stores_and_folders(
    home: Path, place: Place, fleet: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = [(one.folder.name, found[:2]) for one, found in jbclog.open_runs(home).map(rows_of)]
    assert len(here) == RUNS
    for folder in (place.url, home):
        there = [*jbclog.open_runs(folder).map(rows_of, scheduler=fleet.address)]
        assert [(one.folder.name, found[:2]) for one, found in there] == here
        assert os.getpid() not in {found[2] for _, found in there}
    monkeypatch.setattr("jbclog.analysis.runs.MUCH_RUNS", 1)
    there = [*jbclog.open_runs(place.url).map(rows_of)]
    assert [(one.folder.name, found[:2]) for one, found in there] == here
    assert (os.getpid() in {found[2] for _, found in there}) == (len(os.sched_getaffinity(0)) == 1)


def test_the_script_of_the_page_runs(
    place: Place, fleet: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "how-to" / "many-computers.md").read_text(encoding="utf-8")
    script = page.split("```python\n")[1].split("```")[0]
    for old, new in (
        ("/data/plant", place.url),
        ("tcp://10.0.0.5:8786", fleet.address),
        ("2026-11-01", "2026-09-01"),
    ):
        assert old in script
        script = script.replace(old, new)
    (tmp_path / "script.py").write_text(f"{script}    print(len(stations), len(tips))\n")
    runpy.run_path(str(tmp_path / "script.py"), run_name="__main__")
    said = capsys.readouterr()
    assert said.err == ""
    assert len(said.out.splitlines()) == RUNS + 1
    assert said.out.endswith("\n1 1\n")


def test_a_run_that_cannot_be_read_is_named_and_an_error_of_the_function_is_raised(
    fleet: Cluster, tmp_path: Path
) -> None:
    many_runs(tmp_path / "runs", [0.1, 0.2])
    bad, good = sorted((tmp_path / "runs").iterdir())
    for part in bad.rglob("*.parquet"):
        part.write_bytes(b"no table")
    runs = jbclog.open_runs(tmp_path / "runs")
    assert [one.folder for one, _ in runs.map(length, scheduler=fleet.address)] == [good]
    assert [one.folder for one in runs.unreadable] == [bad]
    with pytest.raises(ZeroDivisionError):
        list(runs.map(divided, scheduler=fleet.address))


def test_a_worker_that_is_killed_in_the_middle_changes_no_answer(
    fleet: Cluster, tmp_path: Path
) -> None:
    fleet.worker()  # replaces the killed one
    for name, engine in (("scheduler", Scheduler(fleet.address)), ("processes", Processes(2))):
        mark = tmp_path / name
        found = [*engine.run(partial(killed_at, at=7, mark=mark), range(30))]
        assert mark.exists()
        assert found == [number * number for number in range(30)]


def test_a_result_that_has_arrived_before_a_kill_is_kept(tmp_path: Path) -> None:
    """The next task is begun when the processes are known to be gone."""
    mark = tmp_path / "killed"

    def tasks() -> Iterator[int]:
        yield from range(30)[: processes.AHEAD]
        while not mark.exists():
            time.sleep(0.01)
        time.sleep(1.0)
        yield from range(30)[processes.AHEAD :]

    found = [*Processes(1).run(partial(killed_at, at=1, mark=mark), tasks())]
    assert found == [number * number for number in range(30)]


def test_what_kills_every_process_ends_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "MOST_BREAKS", 0)
    with pytest.raises(RecordError, match="were killed 1 times, perhaps for lack of memory"):
        list(Processes(1).run(ends_always, [1]))


def test_a_scheduler_that_is_gone_before_or_in_the_middle_is_an_error(
    place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with cluster(tmp_path, workers=1) as one:
        results = Scheduler(one.address).run(slow, range(50))
        assert next(results) == 0
        monkeypatch.setattr("jbclog.analysis.fleet.scheduler.CONNECT_S", 1.0)
        one.processes[0].kill()
        with pytest.raises(RecordError, match="the scheduler is gone"):
            list(results)
    _, said = trend(place, "--scheduler", one.address, code=4)
    assert f"{one.address}: no scheduler answers" in said
    assert said.count("\n") == 1


def test_without_workers_from_the_start_or_from_the_middle_on_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("jbclog.analysis.fleet.scheduler.CONNECT_S", 1.0)
    monkeypatch.setattr("jbclog.analysis.fleet.scheduler.NO_WORKER_S", 0.5)
    monkeypatch.setattr("jbclog.analysis.fleet.scheduler.LOOK_S", 0.2)
    with cluster(tmp_path, workers=0) as one:
        with pytest.raises(
            RecordError, match="the scheduler has no worker; start `dask worker tcp://"
        ):
            list(Scheduler(one.address).run(abs, [1]))
        monkeypatch.setattr("jbclog.analysis.fleet.scheduler.CONNECT_S", 30.0)
        worker = one.worker()
        results = Scheduler(one.address).run(slow, range(50))
        assert next(results) == 0
        worker.kill()
        with pytest.raises(RecordError, match=r"since 0\.5 s the scheduler has no worker"):
            list(results)


def test_a_worker_of_another_version_is_refused_also_one_that_joins_later(tmp_path: Path) -> None:
    (tmp_path / "other.py").write_text("import jbclog\njbclog.__version__ = '0.0.1'\n")
    with cluster(tmp_path, workers=1) as one:
        results = Scheduler(one.address).run(slow, range(200))
        assert next(results) == 0
        one.worker("--preload", "other.py")
        with pytest.raises(
            RecordError,
            match=r"a worker has another version: it has jbclog 0\.0\.1, .*Install the same on all",
        ):
            list(results)
        with pytest.raises(
            RecordError,
            match=r"has another version \(1 in all\): jbclog 0\.0\.1, .*here is jbclog 0\.1",
        ):
            list(Scheduler(one.address).run(abs, [1]))


def test_tls_works_with_certificates_and_not_without(
    place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    certificates(tmp_path)
    import dask

    files = {"ca-file": "ca.pem", "client.cert": "node.pem", "client.key": "node.key"}
    ours = {f"distributed.comm.tls.{name}": str(tmp_path / file) for name, file in files.items()}
    with cluster(tmp_path, 1, TLS) as one:
        assert one.address.startswith("tls://")
        _, said = trend(place, "--scheduler", one.address, code=4)
        assert "certificates come from Dask's configuration" in said
        with dask.config.set(ours):
            assert trend(place, "--scheduler", one.address) == trend(place)
        monkeypatch.setattr("jbclog.analysis.fleet.scheduler.CONNECT_S", 1.0)
        with pytest.raises(RecordError, match="no scheduler answers"):
            list(Scheduler(one.address.replace("tls:", "tcp:")).run(abs, [1]))


@pytest.mark.parametrize(
    "address",
    [
        "",
        "8786",
        "host:8786",
        "http://host:8786",
        "tcp://host",
        "tcp://host:99999",
        "tcp://a@b:1",
        "tcp://h:1/x",
    ],
)
def test_what_is_no_address_is_wrong_usage(place: Place, address: str) -> None:
    with pytest.raises(UsageError, match="a scheduler is tcp://HOST:PORT or tls://HOST:PORT"):
        Scheduler(address)
    trend(place, "--scheduler", address, code=2)


def test_a_scheduler_reads_stores_only(home: Path) -> None:
    _, said = trend(home, "--scheduler", "tcp://127.0.0.1:1", code=2)
    assert "is a folder of runs, and a scheduler reads stores; `jbclog publish" in said
