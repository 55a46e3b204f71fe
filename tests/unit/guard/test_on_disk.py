"""What a guard has on the disk: the lease, its lock, its diary. None of it may hang, none of it may
lie.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import stat
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from support.product import (
    FILE_LIMITS,
    LEASE_LOCK,
    LEASES_FILE,
    LEAST_BYTES,
    LINE_BYTES,
    NEW_LEASES_FILE,
    RECORDED_ACTION_LOG,
    RECORDED_LEASES,
    RECORDED_LOCK,
    ActionLog,
    FileKind,
    LeaseWriter,
    RecordError,
    StationLease,
    check_run,
    close_lease,
    guard_lock,
    left_leases,
    patch,
    read_annotations,
    read_leases,
    recorded_actions,
    recover_run,
    registered_runs,
    tidy_actions,
    write_leases,
)
from support.records import few_rows


def lease(name: str = "dde-1", *ports: int) -> StationLease:
    return StationLease(
        name, "/dev/ttyX", 19200, "8N1", 1, "dde", "DDE", "1.0", "stand", ports or (1,), False
    )


# -- the lease -------------------------------------------------------------------------------------


def test_what_holds_something_is_kept_and_nothing_else(tmp_path: Path) -> None:
    write_leases(
        tmp_path,
        [lease("a"), replace(lease("b"), ports=()), replace(lease("c"), ports=(), feeds=True)],
    )
    assert [one.name for one in read_leases(tmp_path)] == ["a", "c"]
    write_leases(tmp_path, [replace(lease("a"), ports=())])
    assert list(tmp_path.iterdir()) == []
    write_leases(tmp_path, [])  # twice is as good as once
    assert read_leases(tmp_path) == []


def test_a_disk_that_does_not_take_a_lease_keeps_the_old_one_and_nothing_of_the_new(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_leases(tmp_path, [lease("a")])

    def fails(descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", fails)
    with pytest.raises(OSError, match="Input/output"):
        write_leases(tmp_path, [lease("b")])
    assert [one.name for one in read_leases(tmp_path)] == ["a"]
    assert [path.name for path in tmp_path.iterdir()] == [LEASES_FILE]


def test_a_lease_and_its_name_are_on_the_disk_when_it_counts_as_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[object] = []

    def note(descriptor: int) -> None:
        found = os.fstat(descriptor)
        synced.append("folder" if stat.S_ISDIR(found.st_mode) else (found.st_ino, found.st_size))

    monkeypatch.setattr(os, "fsync", note)
    write_leases(tmp_path, [lease("a"), lease("b")])
    found = (tmp_path / LEASES_FILE).stat()
    # a power cut at any moment leaves the old one or the new one
    assert synced == [(found.st_ino, found.st_size), "folder"]


def test_a_line_that_cannot_be_read_does_not_hide_the_others(tmp_path: Path) -> None:
    write_leases(tmp_path, [lease("a"), lease("b")])
    first, second = (tmp_path / LEASES_FILE).read_text().splitlines()
    newer = json.dumps(json.loads(first) | {"what a later version has": 1})
    (tmp_path / LEASES_FILE).write_text(f"{newer}\n{second[:-5]}\n\n{second}\n")
    assert [one.name for one in read_leases(tmp_path)] == ["b"]
    assert sorted(left_leases(tmp_path)) == ["a", "b"]  # people are told of both


def test_a_port_is_the_same_by_whatever_link(tmp_path: Path) -> None:
    device, link = tmp_path / "ttyX", tmp_path / "by-id"
    device.touch()
    link.symlink_to(device)
    assert replace(lease(), url=str(link)).is_at(str(device))
    assert replace(lease(), url=str(device)).is_at(str(link))
    assert not replace(lease(), url=str(device)).is_at(str(tmp_path / "ttyY"))
    assert replace(lease(), url="socket://h:1").is_at("socket://h:1")


@pytest.mark.parametrize("name", [LEASES_FILE, f"{LEASES_FILE}.new"])
def test_a_lease_is_never_written_through_a_link(tmp_path: Path, name: str) -> None:
    folder, foreign = tmp_path / "run", tmp_path / "foreign"
    folder.mkdir()
    foreign.write_text("somebody's")
    (folder / name).symlink_to(foreign)
    write_leases(folder, [lease("a")])
    assert foreign.read_text() == "somebody's"
    assert [one.name for one in read_leases(folder)] == ["a"]
    assert [path.name for path in folder.iterdir()] == [LEASES_FILE]
    assert not (folder / LEASES_FILE).is_symlink()


@pytest.mark.parametrize("error", [OSError, MemoryError])
def test_a_lease_that_cannot_be_written_leaves_no_half_of_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[Exception]
) -> None:
    def refuse(descriptor: int) -> None:
        raise error

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(error):
        write_leases(tmp_path, [lease("a")])
    assert list(tmp_path.iterdir()) == []


def test_a_closed_lease_leaves_no_half_of_a_killed_guard_behind(tmp_path: Path) -> None:
    (tmp_path / NEW_LEASES_FILE).write_text("half")
    write_leases(tmp_path, [])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", [LEASES_FILE, RECORDED_ACTION_LOG])
def test_nothing_is_read_or_cut_through_a_link_and_no_pipe_is_waited_for(
    tmp_path: Path, name: str
) -> None:
    folder, foreign = tmp_path / "run", tmp_path / "foreign"
    folder.mkdir()
    foreign.write_text(f"{lease('a').to_json()}\n\n\n")
    (folder / name).symlink_to(foreign)
    for look in (read_leases, left_leases, recorded_actions, tidy_actions):
        with suppress(OSError):
            assert not look(folder)
    with pytest.raises(OSError, match="symbolic links"):
        (
            ActionLog(folder).reserve(1)
            if name == RECORDED_ACTION_LOG
            else os.open(folder / name, os.O_RDONLY | os.O_NOFOLLOW)
        )
    assert foreign.read_text().endswith("\n\n\n")
    (folder / name).unlink()
    os.mkfifo(folder / name)
    for look in (read_leases, left_leases):
        assert not look(folder)


# -- where leases are open -------------------------------------------------------------------------


def test_open_leases_are_found_wherever_their_runs_lie(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folders = [tmp_path / one / "run" for one in "ab"]  # of one name
    for folder in folders:
        folder.mkdir(parents=True)
        write_leases(folder, [lease("a")])
        write_leases(folder, [lease("a"), lease("b")])
    assert sorted(registered_runs().there) == folders
    # whom it shows is nobody else's business
    assert (tmp_path / "state" / "jbclog" / "open-leases").stat().st_mode & 0o077 == 0
    write_leases(folders[0], [])
    assert registered_runs() == (folders[1:], [])
    write_leases(folders[1], [])
    assert registered_runs() == ([], [])
    assert list((tmp_path / "state" / "jbclog" / "open-leases").iterdir()) == []


@pytest.mark.parametrize("gone", ["run", "disk"])
def test_a_lease_whose_folder_is_not_there_is_named_until_its_link_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gone: str
) -> None:
    """Removed by a person or on a disk that is not mounted: no program can know which."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folder, elsewhere = tmp_path / "disk" / "run", tmp_path / "elsewhere"
    folder.mkdir(parents=True)
    write_leases(folder, [lease("a")])
    (link,) = (tmp_path / "state" / "jbclog" / "open-leases").iterdir()
    moved = folder if gone == "run" else folder.parent
    moved.rename(elsewhere)
    away = (
        folder,
        f"{folder} is not there, and its disk may not be mounted (if you removed it, remove {link},"
        " too)",
    )
    assert registered_runs() == ([], [away])
    assert registered_runs() == ([], [away])
    elsewhere.rename(moved)
    assert registered_runs() == ([folder], [])
    shutil.rmtree(moved)
    folder.parent.mkdir(exist_ok=True)
    folder.touch()  # something else of that name
    assert registered_runs() == ([], [away])
    link.unlink()
    assert registered_runs() == ([], [])


def test_a_closed_lease_leaves_no_link_whatever_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    registry, folder = tmp_path / "state" / "jbclog" / "open-leases", tmp_path / "line.1"
    folder.mkdir()
    write_leases(folder, [lease("a")])
    (registry / "by hand").symlink_to(folder)
    assert registered_runs() == ([folder] * 2, [])
    write_leases(folder, [])
    assert list(registry.iterdir()) == []


def test_one_that_cannot_be_looked_at_is_told_and_hides_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    write_leases(tmp_path, [lease("a")])
    away = tmp_path / ("x" * 300)
    link = tmp_path / "state" / "jbclog" / "open-leases" / "a"  # the first of the two
    link.symlink_to(away)
    why = f"{away} cannot be looked at ({os.strerror(errno.ENAMETOOLONG)})"
    assert registered_runs() == ([tmp_path], [(away, why)])
    assert link.is_symlink()


@pytest.mark.parametrize("state", ["", "no absolute path", "file"])
def test_without_a_place_for_that_a_lease_is_kept_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, state: str
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / state) if state == "file" else state)
    monkeypatch.setenv("HOME", str(tmp_path / "file"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "none"))
    write_leases(tmp_path, [lease("a")])
    assert [one.name for one in read_leases(tmp_path)] == ["a"]
    assert registered_runs() == ([], [])
    write_leases(tmp_path, [])


# -- a disk that hangs or is full ------------------------------------------------------------------


def test_a_disk_that_hangs_keeps_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    goes_on, written = threading.Event(), []

    def hanging(folder: Path, stations: list[StationLease]) -> None:
        goes_on.wait(60)
        written.append([station.name for station in stations])

    patch(monkeypatch, "lease.write_leases", hanging)
    lease_writer, began = LeaseWriter(tmp_path, ActionLog(tmp_path)), time.monotonic()
    for name in "abcde":
        lease_writer.put([lease(name)])
    lease_writer.settle(0.05)
    assert time.monotonic() - began < 30
    goes_on.set()
    lease_writer.settle(60.0)
    assert written[-1] == ["e"]  # the newest, whatever came between
    assert len(written) <= 2


def test_a_lease_that_stays_open_is_on_the_disk_before_the_guard_ends(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A take-over may be faster than the disk; a lease stays open where a line of the action log is
    lost.
    """
    really = write_leases
    patch(monkeypatch, "lease.write_leases", lambda *asked: time.sleep(0.3) or really(*asked))
    patch(monkeypatch, "guard.WRITE_S", 60.0)  # a busy machine's disk takes its time
    action_log = ActionLog(tmp_path)
    lease_writer = LeaseWriter(tmp_path, action_log)
    lease_writer.put([lease("a")])
    action_log.is_torn = True
    close_lease([], lease_writer, action_log)
    assert [one.name for one in read_leases(tmp_path)] == ["a"]


def test_a_disk_that_is_full_is_no_reason_to_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lease_writer, really = LeaseWriter(tmp_path, ActionLog(tmp_path)), write_leases

    def full(folder: Path, stations: list[StationLease]) -> None:
        raise OSError(errno.ENOSPC, "no room")

    patch(monkeypatch, "lease.write_leases", full)
    lease_writer.put([lease("a")])
    lease_writer.settle(60.0)
    assert not lease_writer.was_cleared  # it never was there: nobody else has seen to it
    patch(monkeypatch, "lease.write_leases", really)
    lease_writer.put([lease("a")])
    lease_writer.settle(60.0)
    assert [one.name for one in read_leases(tmp_path)] == ["a"]
    (tmp_path / LEASES_FILE).unlink()
    assert lease_writer.was_cleared


def test_a_diary_that_cannot_be_written_is_not_waited_for_and_says_so(tmp_path: Path) -> None:
    (tmp_path / RECORDED_ACTION_LOG).mkdir()
    action_log = ActionLog(tmp_path)
    action_log.write("guard.took_over", "error", "text")
    action_log.tidy()
    assert action_log.is_torn


def test_a_sealed_run_is_never_written_to_again_and_told_beside_its_record(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    action_log = ActionLog(folder, "jbclog run")
    action_log.write("guard.took_over", "error", "before")
    recover_run(folder)
    sealed = (folder / RECORDED_ACTION_LOG).read_bytes()
    action_log.reserve()
    action_log.write("safety.safe_state", "info", "The tool is safe.", "a", 2)
    action_log.tidy()
    assert (check_run(folder), (folder / RECORDED_ACTION_LOG).read_bytes()) == ([], sealed)
    assert [event.text for event in recorded_actions(folder)] == ["before"]
    (said,) = read_annotations(folder).said
    assert (said.who, said.what, said.kind) == (
        "jbclog run",
        "a port 2: The tool is safe.",
        "safety.safe_state",
    )


# -- the diary's room ------------------------------------------------------------------------------


def blocks(folder: Path) -> int:
    return (folder / RECORDED_ACTION_LOG).stat().st_blocks * 512


def test_the_diary_has_its_room_before_it_is_needed_and_gives_it_back(tmp_path: Path) -> None:
    action_log = ActionLog(tmp_path)
    action_log.reserve()
    assert blocks(tmp_path) >= LEAST_BYTES  # written, and not a hole
    action_log.reserve(1000)
    room = blocks(tmp_path)
    assert room >= 1000 * LINE_BYTES
    for number in range(1000):
        action_log.write("safety.safe_state", "info", "x" * 300, "a", number)
    assert blocks(tmp_path) == room
    assert [event.port for event in recorded_actions(tmp_path)] == list(range(1000))
    action_log.tidy()
    assert (tmp_path / RECORDED_ACTION_LOG).read_bytes().splitlines()[-1].startswith(b"{")
    assert blocks(tmp_path) < room


def test_a_disk_that_is_full_takes_what_there_is_room_for_and_it_is_seen_where_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    action_log, really = ActionLog(tmp_path), os.pwrite
    action_log.reserve()

    def full(descriptor: int, data: bytes, at: int) -> int:
        room = os.fstat(descriptor).st_size - at
        if room <= 0:
            raise OSError(errno.ENOSPC, "no room")
        return really(descriptor, data[:room], at)

    monkeypatch.setattr(os, "pwrite", full)
    lines = 0
    while not action_log.is_torn:
        action_log.write("safety.safe_state", "info", "x" * 300, "a", lines)
        lines += 1
    assert lines > LEAST_BYTES / LINE_BYTES
    assert [event.port for event in recorded_actions(tmp_path)] == list(range(lines - 1))


def test_a_diary_that_nothing_was_written_into_is_none(tmp_path: Path) -> None:
    action_log = ActionLog(tmp_path)
    action_log.reserve()
    assert recorded_actions(tmp_path) == []
    action_log.tidy()
    action_log.tidy()
    assert list(tmp_path.iterdir()) == []


def tidied_by_a_guard(folder: Path) -> None:
    ActionLog(folder).tidy()


TIDIES = (tidy_actions, tidied_by_a_guard)


@pytest.mark.parametrize("tidy", TIDIES)
def test_what_takes_the_diarys_name_while_it_is_tidied_is_not_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tidy: Callable[[Path], None]
) -> None:
    path, other, really = tmp_path / RECORDED_ACTION_LOG, tmp_path / "other", os.open
    path.write_text("{}\n\n\n")
    other.write_text("a longer line than that\n")

    def swapping(name: Path, *how: int, **more: int) -> int:
        descriptor = really(name, *how, **more)
        if name == path and other.exists():
            other.replace(path)
        return descriptor

    monkeypatch.setattr(os, "open", swapping)
    tidy(tmp_path)
    monkeypatch.undo()
    assert path.read_text() == "a longer line than that\n"


@pytest.mark.parametrize("tidy", TIDIES)
def test_a_diary_that_no_guard_has_written_is_not_tidied(
    tmp_path: Path, tidy: Callable[[Path], None]
) -> None:
    path, size = tmp_path / RECORDED_ACTION_LOG, FILE_LIMITS[FileKind.ACTION_LOG] + 1
    path.write_bytes(b"\n" * size)
    with suppress(OSError):
        tidy(tmp_path)
    assert path.stat().st_size == size


def test_a_line_behind_one_that_was_torn_off_is_whole(tmp_path: Path) -> None:
    action_log = ActionLog(tmp_path)
    action_log.reserve()
    action_log.write("guard.took_over", "error", "first")
    with (tmp_path / RECORDED_ACTION_LOG).open("r+b") as file:
        data = file.read().rstrip(b"\n")
        file.seek(len(data) - 10)
        file.write(b"\n" * 10)
    ActionLog(tmp_path).write("guard.took_over", "error", "second")
    assert [event.text for event in recorded_actions(tmp_path)] == ["second"]


def test_a_reserve_does_not_cover_what_stands_there(tmp_path: Path) -> None:
    ActionLog(tmp_path).write("guard.took_over", "error", "first")
    second = ActionLog(tmp_path)
    second.reserve()
    second.write("guard.took_over", "error", "second")
    assert [event.text for event in recorded_actions(tmp_path)] == ["first", "second"]


# -- one guard -------------------------------------------------------------------------------------


def test_guard_and_record_mean_the_same_files() -> None:
    assert (RECORDED_LOCK, RECORDED_LEASES) == (LEASE_LOCK, LEASES_FILE)


def test_there_is_one_and_not_two(tmp_path: Path) -> None:
    with (
        guard_lock(tmp_path),
        pytest.raises(RecordError, match="has a guard already"),
        guard_lock(tmp_path, 0.05),
    ):
        pass
    with guard_lock(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_lock_whose_file_was_taken_away_meanwhile_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first ends and removes its file just when a second has opened it; a third makes a new
    one, and is it.
    """
    flock, first, third = fcntl.flock, guard_lock(tmp_path), guard_lock(tmp_path)
    first.__enter__()

    def second_comes_late(descriptor: int, operation: int) -> None:
        monkeypatch.setattr(fcntl, "flock", flock)
        first.__exit__(None, None, None)
        third.__enter__()
        flock(descriptor, operation)  # which it gets: nobody else has this file any more

    monkeypatch.setattr(fcntl, "flock", second_comes_late)
    with pytest.raises(RecordError, match="has a guard already"), guard_lock(tmp_path):
        pass
    third.__exit__(None, None, None)
    assert list(tmp_path.iterdir()) == []


def test_recovery_waits_for_a_guard_that_is_at_work(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    with (
        guard_lock(folder),
        pytest.raises(RecordError, match="its guard is at work; nothing was changed"),
    ):
        recover_run(folder, 0.1)
    ActionLog(folder).write(
        "safety.safe_state", "info", "The tool was put in its safe state.", "a", 1
    )
    (folder / LEASE_LOCK).touch()  # as one that was killed leaves it
    recover_run(folder, 0.1)
    assert not (folder / LEASE_LOCK).exists()
    assert check_run(folder) == []


def test_a_lock_that_is_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").touch()
    (tmp_path / LEASE_LOCK).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match=os.strerror(errno.ELOOP)), guard_lock(tmp_path):
        pass
