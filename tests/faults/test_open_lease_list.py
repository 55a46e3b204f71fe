"""Where the list of open leases goes when the state folder cannot be written: on real file systems
and as a real user (docs/reference/faults.md, F-53).
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pandas as pd
import pytest

from support.command import jbclog, until
from support.faults.guarded import (
    TOOLS,
    ended,
    guard_that_is_there,
    only_run,
    running,
)
from support.faults.small_disk import fill, small_disk
from support.product import LEASES_SEEN_BY_USER, read_leases
from support.virtual.served_line import ServedLine

pytestmark = pytest.mark.usefixtures("own_state")
NOBODY, WITHOUT_A_NAME = 65_534, 54_321


def seen_by(user: int, folder: Path, environment: Mapping[str, str]) -> dict[str, object]:
    """What a user sees who writes a lease of a run in `folder`."""
    kept = {name: os.environ[name] for name in ("PATH", "LANG", "LC_ALL") if name in os.environ}
    command = [sys.executable, "-c", LEASES_SEEN_BY_USER, str(folder), str(user)]
    ended = subprocess.run(
        command, capture_output=True, text=True, env={**kept, **environment}, check=False
    )
    assert ended.returncode == 0, ended.stderr
    told: dict[str, object] = json.loads(ended.stdout)
    return told


@contextmanager
def read_only(place: Path) -> Iterator[Path]:
    with small_disk(place, "1m"):
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        yield place


def read_only_home(place: Path, stack: ExitStack) -> dict[str, str]:
    return {"HOME": str(stack.enter_context(read_only(place)))}


def no_home(_: Path, __: ExitStack) -> dict[str, str]:
    return {}


def full_state(place: Path, stack: ExitStack) -> dict[str, str]:
    disk = stack.enter_context(small_disk(place, "64k,nr_inodes=4"))
    disk.chmod(0o777)
    fill(disk)
    for number in range(9):
        try:
            (disk / str(number)).touch()
        except OSError:
            break
    return {"XDG_STATE_HOME": str(disk)}


def of_another_user(place: Path, _: ExitStack) -> dict[str, str]:
    place.mkdir(mode=0o700)
    return {"XDG_STATE_HOME": str(place)}


@pytest.fixture
def world() -> Iterator[Path]:
    """A folder that every user may enter, as those of pytest are not."""
    if os.geteuid() != 0:
        pytest.skip("needs root, to become another user")
    with tempfile.TemporaryDirectory(prefix="jbclog-lists-") as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.mark.parametrize("has_runtime", [True, False])
@pytest.mark.parametrize(
    ("state", "user", "why"),
    [
        (read_only_home, NOBODY, "Read-only file system"),
        (no_home, WITHOUT_A_NAME, "this user has no home folder"),
        (full_state, NOBODY, "No space left on device"),
        (of_another_user, NOBODY, "Permission denied"),
    ],
)
def test_it_goes_to_the_runtime_folder_else_it_is_reported_as_missing(
    state: Callable[[Path, ExitStack], dict[str, str]],
    user: int,
    why: str,
    has_runtime: bool,
    world: Path,
) -> None:
    run, runtime = world / "runs" / "run", world / "runtime"
    run.mkdir(parents=True)
    os.chown(run, user, user)
    if has_runtime:
        runtime.mkdir(mode=0o700)
        os.chown(runtime, user, user)
    with ExitStack() as stack:
        places = state(world / "state", stack) | {"XDG_RUNTIME_DIR": str(runtime)}
        seen = seen_by(user, run, places)
    assert why in seen["why"][0]  # type: ignore[index]
    assert seen["closed"]
    if has_runtime:
        assert seen["registry"] == str(runtime / "jbclog" / "open-leases")
        assert seen["there"] == [str(run)]
        assert seen["left"] == []
        is_listed, text = seen["about"]  # type: ignore[misc]
        assert is_listed
        assert "which a restart of the host empties" in text
        assert seen["looked"][0] == "Fine"  # type: ignore[index]
        return
    assert seen["registry"] is None
    assert seen["there"] == []
    assert not runtime.exists(), "the system makes it"
    kind, name, what, step = seen["looked"]  # type: ignore[misc]
    assert (kind, name) == ("ScanFinding", "guard.list")
    assert why in what
    assert "only a run with the same --out makes the tools safe" in what
    assert step == "set XDG_STATE_HOME to a folder that this user can write"


# -- a run -----------------------------------------------------------------------------------------


@pytest.fixture
def line(tmp_path: Path) -> Iterator[ServedLine]:
    (tmp_path / "line").mkdir()
    with ServedLine(tmp_path / "line") as served:
        served.cool_soon()
        yield served


@pytest.fixture
def read_only_state(
    own_state: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Path]:
    with read_only(tmp_path / "home") as home:
        monkeypatch.delenv("XDG_STATE_HOME")
        monkeypatch.setenv("HOME", str(home))
        yield home


def next_run(line: ServedLine, out: Path) -> pd.DataFrame:
    """The events of a run of a second."""
    done = jbclog("run", line.recipe, "--line", line.path, "--out", out, "-d", "1s", "--json")
    return pd.read_parquet(Path(json.loads(done.stdout)["folder"]) / "events").set_index("kind")


def leave_hot(line: ServedLine, out: Path) -> Path:
    """Kill recorder and guard while all tools are at work; return the folder of their run."""
    with running(line, out) as run:
        folder = only_run(out)
        assert until(lambda: sum(len(lease.ports) for lease in read_leases(folder)) == TOOLS)
        os.kill(run.pid, signal.SIGSTOP)
        os.kill(guard_that_is_there(run.pid), signal.SIGKILL)
        run.kill()
        ended(run)
    assert line.at_work() == TOOLS, "somebody has saved them already"
    return folder


@pytest.mark.usefixtures("read_only_state")
def test_the_next_run_finds_hot_tools_where_the_home_folder_is_read_only(
    line: ServedLine, tmp_path: Path
) -> None:
    folder = leave_hot(line, tmp_path / "runs")
    events = next_run(line, tmp_path / "another")
    assert f"Run {folder.name} ended without making the tools" in events.loc["guard.left_over"].text
    assert events.loc["guard.list"].severity == "info"
    assert not read_leases(folder)


@pytest.mark.usefixtures("read_only_state")
def test_a_run_says_where_no_list_can_be_written_and_the_same_out_still_finds_it(
    line: ServedLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "none"))
    folder = leave_hot(line, tmp_path / "runs")
    elsewhere = jbclog("doctor", "--line", line.path, "--out", tmp_path / "runs")
    assert "open leases" in elsewhere.stdout
    assert "set XDG_STATE_HOME to a folder that this user can write" in elsewhere.stdout
    events = next_run(line, tmp_path / "runs")
    assert f"Run {folder.name} ended without making the tools" in events.loc["guard.left_over"].text
    listed = events.loc["guard.list"]
    assert listed.severity == "warning"
    assert "Read-only file system" in listed.text
    assert "set XDG_STATE_HOME to a folder that this user can write" in listed.text


@pytest.mark.usefixtures("read_only_state")
def test_safe_closes_a_lease_that_is_in_no_list(
    line: ServedLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "none"))
    folder = leave_hot(line, tmp_path / "runs")
    done = jbclog("safe", "--line", line.path, "--out", tmp_path / "runs")
    assert done.returncode == 0, done.stderr
    assert str(folder) in done.stderr
    assert not read_leases(folder)
