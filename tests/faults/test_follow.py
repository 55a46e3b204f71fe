"""`publish --follow` survives its store: a server that stops, a share that disappears, a full disk.
It loses nothing and prints little.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import pytest

import jbclog
from jbclog.analysis.store.place import Place, place_of
from jbclog.app.publish import follow, lease
from jbclog.app.publish.folder import Skipped
from jbclog.app.publish.follow import Follower, Trouble
from jbclog.app.publish.lease import leases
from jbclog.app.publish.publisher import Outcome, Publisher
from jbclog.app.publish.upkeep import check
from support.faults.s3_server import BUCKET, serving
from support.faults.small_disk import small_disk
from support.invoked import invoked
from support.records.many_runs import one_run

OFTEN = "from jbclog.app.publish import follow; follow.LOOK_EVERY_S = 0.5; "  # pauses are below
COMMAND = [sys.executable, "-c", f"{OFTEN}from jbclog.cli import main; main()"]


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    one_run(tmp_path / "runs", 0)
    return tmp_path / "runs"


def kinds(follower: Follower) -> list[str]:
    return [type(one).__name__ for one in follower.poll()]


def whole(place: Place, number: int) -> None:
    """Whether that many runs are there, and nothing of an interrupted publisher."""
    assert len(jbclog.open_runs(place.url)) == number
    found = check(place, timedelta(0))
    assert (found.findings, found.leftovers, found.runs) == ([], [], number)


@contextmanager
def following(runs: Path, store: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    command = [*COMMAND, "publish", str(runs), store, "--follow"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | environment | {"COLUMNS": "400"},
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait(20)


def line_of(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


def test_a_server_that_stops_and_starts(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command reports once that it is gone and once that it is back, publishes the runs sealed
    meanwhile, and ends on SIGTERM.
    """
    with serving() as server:
        for name, value in server.environment.items():
            monkeypatch.setenv(name, value)
        url = f"s3://{BUCKET}/plant"
        with following(runs, url) as process:
            assert "publishing what is sealed" in line_of(process)
            assert "published (version 1)" in line_of(process)
            server.stop()
            one_run(runs, 1)
            gone = line_of(process)
            assert gone.startswith(f"{url}: ")
            assert "tried again" in gone
            server.start()
            said = [line_of(process), line_of(process)]
            assert sorted("published" in line for line in said) == [False, True]
            assert f"{url} is written again\n" in said
            process.send_signal(signal.SIGTERM)
            rest, _ = process.communicate(timeout=60)
            assert (process.returncode, rest) == (143, "")
        assert [*leases(place_of(url))] == []
        whole(place_of(url), 2)


def test_it_ends_while_the_store_is_away(runs: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    with following(runs, str(store)) as process:
        assert "publishing what is sealed" in line_of(process)
        assert "published" in line_of(process)
        store.rename(tmp_path / "elsewhere")
        one_run(runs, 1)
        assert "is missing" in line_of(process)
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=60)
    assert (process.returncode, rest) == (0, "")
    assert not store.exists()


@pytest.fixture
def follower(runs: Path, tmp_path: Path) -> Iterator[Follower]:
    with Publisher(place_of(tmp_path / "store")) as one:
        found = Follower(one, runs)
        assert kinds(found) == ["Outcome"]
        yield found


def test_a_share_that_goes_and_comes_back(follower: Follower, runs: Path, tmp_path: Path) -> None:
    """It is not created where it is not mounted; the pause grows to a minute and is short again
    afterwards.
    """
    store = tmp_path / "store"
    store.rename(tmp_path / "elsewhere")
    (tmp_path / "mount point").mkdir()
    one_run(runs, 1)
    pauses = []
    for is_first in (True, False, False, False, False):
        assert kinds(follower) == ["Trouble"] * is_first
        pauses.append(follower.pause_s)
    assert pauses == [10, 20, 40, 60, 60]
    assert not store.exists()
    (tmp_path / "elsewhere").rename(store)
    assert kinds(follower) == ["Trouble", "Outcome"]
    assert follower.pause_s == follow.LOOK_EVERY_S
    assert kinds(follower) == []
    follower._publisher.__exit__()
    whole(place_of(store), 2)


def test_the_folder_of_the_runs_goes_and_comes_back(
    follower: Follower, runs: Path, tmp_path: Path
) -> None:
    runs.rename(tmp_path / "elsewhere")
    said = [*follower.poll(), *follower.poll()]
    assert [str(one) for one in said] == [
        f"{runs} cannot be read: No such file or directory; it is tried again"
    ]
    (tmp_path / "elsewhere").rename(runs)
    one_run(runs, 1)
    assert kinds(follower) == ["Trouble", "Outcome"]


def test_a_disk_that_is_full_for_a_while(runs: Path, tmp_path: Path) -> None:
    """Many tries on a full disk do not fill it further, and leave nothing."""
    with small_disk(tmp_path / "disk", "8m") as disk:
        place, filler = place_of(disk / "store"), disk / "filler"
        with Publisher(place) as one:
            follower = Follower(one, runs)
            left = os.statvfs(disk)
            filler.write_bytes(bytes(left.f_bavail * left.f_frsize - 40_000))
            said = [one for _ in range(4) for one in follower.poll()]
            assert [type(one) for one in said] == [Trouble]
            assert "No space left" in str(said[0])
            filler.unlink()
            assert kinds(follower) == ["Trouble", "Outcome"]
        whole(place, 1)


def test_a_lease_that_cannot_be_renewed_ends_nothing(
    follower: Follower, runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A removed lease is created anew; if the store is gone, nothing is created."""
    monkeypatch.setattr(lease, "RENEWED_S", 0.0)
    place = place_of(tmp_path / "store")
    (before,) = leases(place)
    shutil.rmtree(place.of(lease.FOLDER))
    assert kinds(follower) == []
    (after,) = leases(place)
    assert (after.publisher, after.holder) == (before.publisher, before.holder)
    Path(place.url).rename(tmp_path / "elsewhere")
    assert kinds(follower) == []
    assert not Path(place.url).exists()


def test_a_refused_run_is_tried_again_when_a_file_of_it_changes(
    follower: Follower, runs: Path
) -> None:
    bad = one_run(runs, 1)
    extra = bad / "recipes" / "extra.toml"
    extra.parent.mkdir(exist_ok=True)
    extra.write_text("x = 1\n")
    (said,) = follower.poll()
    assert isinstance(said, Skipped)
    assert "extra.toml" in str(said)
    assert kinds(follower) == kinds(follower) == []
    extra.unlink()
    (said,) = follower.poll()
    assert isinstance(said, Outcome)


def test_a_run_for_which_the_store_always_fails_blocks_no_other(
    follower: Follower, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = one_run(runs, 1), one_run(runs, 2)
    real = Publisher.publish

    def failing(self: Publisher, folder: Path) -> Outcome:
        if folder == first:
            raise follow.StoreError("the server refuses so large an object")
        return real(self, folder)

    monkeypatch.setattr(Publisher, "publish", failing)
    assert kinds(follower) == ["Trouble"]
    said = [*follower.poll()]
    assert [type(one).__name__ for one in said] == ["Trouble", "Outcome", "Trouble"]
    assert second.name in str(said[1])
    assert kinds(follower) == []
    monkeypatch.undo()
    assert kinds(follower) == ["Trouble", "Outcome"]


def test_without_follow_a_store_that_goes_ends_it_with_one_line(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not with a line for each remaining run."""
    for number in (1, 2):
        one_run(runs, number)
    store, real = tmp_path / "store", Publisher.publish

    def going(self: Publisher, folder: Path) -> Outcome:
        found = real(self, folder)
        if store.exists():
            store.rename(tmp_path / "elsewhere")
        return found

    monkeypatch.setattr(Publisher, "publish", going)
    ended = invoked("publish", runs, store)
    assert (ended.exit_code, len(ended.stdout.splitlines()), len(ended.stderr.splitlines())) == (
        4,
        1,
        1,
    )
    assert ended.stderr.startswith(f"error: {store}: ")


def test_an_error_of_the_run_in_the_middle_of_a_table_is_the_runs(
    follower: Follower, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The library reports it as its own; the run is refused, and the store is not away."""
    from jbclog.app.publish import publisher
    from jbclog.core.errors import RecordError

    real: Callable[..., Iterator[object]] = publisher.rows_of

    def failing(run: jbclog.Run, table: str) -> Iterator[object]:
        yield from real(run, table)
        if table == "samples":
            raise RecordError(f"{run.folder}: a row group of it is damaged")

    monkeypatch.setattr(publisher, "rows_of", failing)
    run = one_run(runs, 1)
    (said,) = follower.poll()
    assert isinstance(said, Skipped)
    assert str(said) == f"{run}: a row group of it is damaged"
