"""One writer to a folder, found out by the system's own lock; the next one is told who it is."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from jbclog.core.errors import RecordError
from jbclog.core.locks import NAME, FolderLock, is_held, unkept_rows
from jbclog.core.operating_system import boot_id


def test_the_second_is_refused_with_the_holders_number(tmp_path: Path) -> None:
    lock = FolderLock.take(tmp_path)
    with pytest.raises(RecordError, match=f"process {os.getpid()}"):
        FolderLock.take(tmp_path, 0.0)
    said = json.loads((tmp_path / NAME).read_text())
    assert (said["pid"], said["boot"], said["unkept"]) == (os.getpid(), boot_id(), 0)
    assert is_held(tmp_path)
    lock.release()
    assert not is_held(tmp_path)
    FolderLock.take(tmp_path, 0.0).remove()
    assert list(tmp_path.iterdir()) == []
    assert not is_held(tmp_path)


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir], ids=["pipe", "folder"])
def test_what_is_no_file_is_held_by_nobody(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / NAME)
    assert not is_held(tmp_path)


def test_a_holder_that_was_killed_holds_nothing(tmp_path: Path) -> None:
    program = (
        "from jbclog.core.locks import FolderLock; from pathlib import Path; import os, signal\n"
    )
    program += f"FolderLock.take(Path({str(tmp_path)!r})); os.kill(os.getpid(), signal.SIGKILL)"
    subprocess.run([sys.executable, "-c", program], check=False)
    assert (tmp_path / NAME).exists()
    FolderLock.take(tmp_path, 0.0).release()


def test_a_child_that_inherited_it_holds_it_alone(tmp_path: Path) -> None:
    lock = FolderLock.take(tmp_path)
    child = subprocess.Popen(
        [sys.executable, "-c", "input()"], stdin=subprocess.PIPE, pass_fds=[lock.descriptor]
    )
    lock.release()
    with pytest.raises(RecordError, match="or its sealing child"):
        FolderLock.take(tmp_path, 0.0)
    child.communicate(b"\n")
    FolderLock.take(tmp_path, 0.0).release()


def test_patience_waits_for_the_end_of_the_other(tmp_path: Path) -> None:
    lock, began = FolderLock.take(tmp_path), time.monotonic()
    threading.Timer(0.15, lock.release).start()
    FolderLock.take(tmp_path, 60.0).release()
    assert 0.15 <= time.monotonic() - began < 30


def test_a_lock_whose_file_was_removed_meanwhile_is_not_taken_for_one(tmp_path: Path) -> None:
    """The one that waited got the lock of a file that nobody else will ever look at; it must take
    the new one.
    """
    first = FolderLock.take(tmp_path)
    taken: list[FolderLock] = []
    waiting = threading.Thread(target=lambda: taken.append(FolderLock.take(tmp_path, 60.0)))
    waiting.start()
    time.sleep(0.1)
    first.remove()
    waiting.join()
    with pytest.raises(RecordError):
        FolderLock.take(tmp_path, 0.0)
    taken[0].release()


def test_the_number_of_rows_not_kept_outlives_its_holder(tmp_path: Path) -> None:
    lock = FolderLock.take(tmp_path)
    lock.write_unkept(123_456_789)
    lock.write_unkept(12)
    lock.release()
    assert unkept_rows(tmp_path) == 12
    FolderLock.take(tmp_path).release()  # whoever comes next keeps it
    assert unkept_rows(tmp_path) == 12


def test_a_disk_that_gives_no_lock_is_told_of(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="cannot be opened"):
        FolderLock.take(tmp_path / "not there")


def test_nonsense_in_the_file_is_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / NAME).write_text("[1, 2")
    FolderLock.take(tmp_path).release()
