"""Who holds a station's port, as another process can see it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from jbclog.core.locks import NAME as LOCK
from jbclog.core.rows import StationFacts
from jbclog.record.folder import create_run
from jbclog.record.manifest import Manifest, read_manifest, write_manifest
from jbclog.record.port_owner import run_of, run_that_holds, runs_in_progress
from jbclog.record.run_journal import RunJournal

URL = f"socket://host-{os.getpid()}:4001"  # runs of other workers are seen from here too


@pytest.fixture
def run(tmp_path: Path) -> Iterator[tuple[Path, RunJournal]]:
    """A run in progress with two stations, recorded by this process; nothing has been stored of
    them yet.
    """
    folder = create_run(tmp_path / "runs", "bench", 1_790_000_000.0)
    stations = [
        StationFacts("dde-1", str(tmp_path / "dde-1"), "dde"),
        StationFacts("tcp-1", URL, "dde"),
    ]
    write_manifest(folder, Manifest(folder.name, stations=stations))
    store = RunJournal(folder)
    store.start()
    yield folder, store
    store.close()
    store.release()


def test_a_run_holds_the_ports_of_its_stations(
    run: tuple[Path, RunJournal], tmp_path: Path
) -> None:
    folder, _ = run
    assert folder in list(runs_in_progress())
    assert run_of(os.getpid()) == folder
    assert run_that_holds(URL) == folder
    assert run_that_holds(str(tmp_path / "dde-1")) == folder
    assert run_that_holds(str(tmp_path / "dde-2")) is None
    assert run_that_holds("socket://127.0.0.1:4002") is None


def test_a_link_to_the_port_is_that_port(run: tuple[Path, RunJournal], tmp_path: Path) -> None:
    folder, _ = run
    (tmp_path / "dde-1").write_text("a device")
    (tmp_path / "by-id").symlink_to(tmp_path / "dde-1")
    assert run_that_holds(str(tmp_path / "by-id")) == folder


def test_a_station_whose_session_has_ended_is_held_no_more(run: tuple[Path, RunJournal]) -> None:
    folder, store = run
    store.facts(StationFacts("tcp-1", URL, "dde", outcome="running"))
    store.commit_now()
    assert run_that_holds(URL) == folder
    store.facts(StationFacts("tcp-1", URL, "dde", outcome="stopped"))
    store.commit_now()
    assert run_that_holds(URL) is None


def test_a_sealed_run_and_one_without_a_manifest_hold_nothing(run: tuple[Path, RunJournal]) -> None:
    folder, _ = run
    manifest = read_manifest(folder)
    manifest.state = "sealed"
    write_manifest(folder, manifest)
    assert run_that_holds(URL) is None
    (folder / "manifest.json").unlink()
    assert run_that_holds(URL) is None


def test_a_run_whose_recorder_is_gone_holds_nothing(run: tuple[Path, RunJournal]) -> None:
    _, store = run
    store.close()
    store.release()
    assert run_that_holds(URL) is None
    assert run_of(os.getpid()) is None


def test_a_pipe_in_the_lock_s_place_that_somebody_has_open_holds_nothing(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    os.mkfifo(tmp_path / "run" / LOCK)
    opened = os.open(tmp_path / "run" / LOCK, os.O_RDWR | os.O_NONBLOCK)
    try:
        assert tmp_path / "run" not in runs_in_progress()
    finally:
        os.close(opened)


def test_the_recorder_may_be_another_process(tmp_path: Path) -> None:
    folder = create_run(tmp_path, "bench", 1_790_000_000.0)
    write_manifest(folder, Manifest(folder.name, stations=[StationFacts("tcp-1", URL, "dde")]))
    script = "import sys; from pathlib import Path; from jbclog.core.locks import FolderLock\n"
    script += (
        "lock = FolderLock.take(Path(sys.argv[1])); print('held', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        assert run_that_holds(URL) == folder
        assert run_of(other.pid) == folder
        other.kill()
        other.wait()
        assert run_that_holds(URL) is None
        assert run_of(other.pid) is None


def test_a_server_s_port_is_known_under_all_names_of_its_host(tmp_path: Path) -> None:
    number = 20000 + os.getpid() % 20000  # runs of other workers are seen from here too
    folder = create_run(tmp_path, "bench", 1_790_000_000.0)
    write_manifest(
        folder,
        Manifest(
            folder.name, stations=[StationFacts("tcp-1", f"socket://127.0.0.1:{number}", "dde")]
        ),
    )
    store = RunJournal(folder)
    try:
        store.start()
        assert run_that_holds(f"socket://localhost:{number}") == folder
        assert run_that_holds(f"socket://LOCALHOST:{number}?logging=debug") == folder
        assert run_that_holds(f"socket://localhost:{number + 1}") is None
    finally:
        store.close()
        store.release()
