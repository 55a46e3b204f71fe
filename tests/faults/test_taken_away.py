"""Resources taken from a recorder in mid-run: descriptors, file size, memory. Its record then has
gaps.

The limits are those of the real process (`prlimit`); the virtual stations show the state of the
tools.
"""

from __future__ import annotations

import resource
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.command import until
from support.faults.guarded import TOOLS, begun, ended, guard_of, guard_that_is_there, only_run
from support.product import check_run, recover_run
from support.virtual.served_line import ServedLine

pytestmark = pytest.mark.usefixtures("own_state")
AT_WORK_S = 2.0


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedLine]:
    with ServedLine(tmp_path_factory.mktemp("line")) as served:
        yield served


def take(run: subprocess.Popen[str], what: int, most: int) -> None:
    """Limit the running process to `most` of it."""
    resource.prlimit(run.pid, what, (most, resource.prlimit(run.pid, what)[1]))


@pytest.mark.parametrize(
    ("what", "most", "codes"),
    [
        (resource.RLIMIT_NOFILE, 3, {4}),
        (resource.RLIMIT_FSIZE, 0, {4}),
        (resource.RLIMIT_FSIZE, 70_000, {0, 4}),
        (resource.RLIMIT_AS, 1 << 20, {4}),
    ],
    ids=["no descriptors", "no file size", "little file size", "no memory"],
)
def test_a_recorder_from_which_it_is_taken_makes_its_tools_safe_and_ends_with_4(
    line: ServedLine, tmp_path: Path, what: int, most: int, codes: set[int]
) -> None:
    """Or with 0 if the record is whole all the same: it continues in further files."""
    run = begun(line, tmp_path)
    try:
        assert until(lambda: line.at_work() == TOOLS), run.communicate(timeout=5)
        take(run, what, most)
        time.sleep(AT_WORK_S)
        run.terminate()
        notes = ended(run)
    finally:
        run.kill()
    assert line.at_work() == 0
    assert run.returncode in codes, notes
    assert "Traceback" not in notes
    assert f"{TOOLS} tools are in their safe state, as read back" in "\n".join(
        notes.splitlines()[-2:]
    )
    folder = only_run(tmp_path)
    if run.returncode:
        recover_run(folder)
    assert check_run(folder) == []


def test_a_guard_from_which_memory_is_taken_makes_tools_safe_and_ends(
    line: ServedLine, tmp_path: Path
) -> None:
    """It gets no more memory, and then its recorder dies."""
    run = begun(line, tmp_path)
    try:
        assert until(lambda: line.at_work() == TOOLS), run.communicate(timeout=5)
        guard = guard_that_is_there(run.pid)
        resource.prlimit(
            guard, resource.RLIMIT_AS, (1 << 20, resource.prlimit(guard, resource.RLIMIT_AS)[1])
        )
        time.sleep(0.5)
        assert guard_of(run.pid) == guard
    finally:
        run.kill()
    assert until(lambda: line.at_work() == 0, 15)
    assert until(lambda: not Path(f"/proc/{guard}").exists(), 30)
    ended(run)
