"""What somebody else made safe closes the lease that a run left open, as far as it was read back
and no further.
"""

from __future__ import annotations

import errno
import os
import time
from dataclasses import replace
from pathlib import Path

import pytest

from support.faults.guarded import actions_in
from support.product import (
    LEASES_FILE,
    RUN_LOCK,
    IsRecording,
    LeftOver,
    Seen,
    StationLease,
    close_leases,
    guard_lock,
    is_lock_held,
    patch,
    read_leases,
    runs_below,
    settle_leases,
    write_leases,
)

URL = "/dev/no1"
LEASE = StationLease("ale-1", URL, 19200, "8N1", 1, "ale", "ALE", "1.0", "stand", (1, 2), True)
OTHER = replace(LEASE, name="dde-2", url="/dev/no2")
STOOD: dict[int, str | None] = {1: "stand", 2: "sleep"}
SAFE = Seen("ALE", STOOD, True)
FOUND = [
    ("safety.safe_state", "info", 1, "The tool was found safe, as read back: stand."),
    ("safety.safe_state", "info", 2, "The tool was found safe, as read back: sleep."),
]
NO_TOOL = ("safety.safe_state", "info", 2, "The port no longer has a tool.")
ALL_SAFE = (
    "guard.left_over",
    "error",
    None,
    "Run run ended without making the tools of ale-1 safe; every tool is in its safe state now.",
)
NOT_ALL = (
    "guard.left_over",
    "critical",
    None,
    "Run run ended without making the tools of ale-1 safe; not every tool could be made safe.",
)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a run that was cut off with two lines in use."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folder = tmp_path / "run"
    folder.mkdir()
    write_leases(folder, [LEASE, OTHER])
    return folder


def nobody(folder: Path) -> bool:
    return False


@pytest.mark.parametrize(
    ("seen", "left", "lines"),
    [
        (SAFE, None, [*FOUND, ALL_SAFE]),
        (Seen("ALE", {1: "stand", 2: None}, True), None, [FOUND[0], NO_TOOL, ALL_SAFE]),
        (Seen("ALE", {1: "stand"}, True), ((2,), False), [FOUND[0], NOT_ALL]),
        (Seen("ALE", STOOD, False), ((), True), [*FOUND, NOT_ALL]),
        (Seen("ALE", {}, True), ((1, 2), False), [NOT_ALL]),
    ],
    ids=["all", "one unplugged", "one port", "feeder runs", "feeder only"],
)
def test_what_was_read_back_closes_so_much_of_the_lease(
    run: Path,
    seen: Seen,
    left: tuple[tuple[int, ...], bool] | None,
    lines: list[tuple[str, str, int | None, str]],
) -> None:
    assert close_leases(
        [URL], lambda station: seen if station == LEASE else None, nobody, "jbclog safe"
    ) == [run]
    after = {one.name: one for one in read_leases(run)}
    assert after["dde-2"] == OTHER  # nobody has looked at it
    assert ("ale-1" in after) == (left is not None)
    if left is not None:
        assert after["ale-1"] == replace(LEASE, ports=left[0], feeds=left[1])
    assert actions_in(run) == lines


def test_of_two_of_which_one_may_be_hot_not_every_tool_is_safe(run: Path) -> None:
    seen = {"ale-1": SAFE, "dde-2": Seen("ALE", {1: "stand"}, True)}
    assert close_leases(
        [URL, OTHER.url], lambda station: seen[station.name], nobody, "jbclog safe"
    ) == [run]
    assert read_leases(run) == [replace(OTHER, ports=(2,), feeds=False)]
    kind, severity, _, text = actions_in(run)[-1]
    assert (kind, severity) == ("guard.left_over", "critical")
    assert (
        text
        == "Run run ended without making the tools of ale-1, dde-2 safe; not every tool could be"
        " made safe."
    )


@pytest.mark.parametrize(
    "seen",
    [None, SAFE._replace(model="ALF"), SAFE._replace(model=None)],
    ids=["nobody", "other", "nameless"],
)
def test_where_another_was_seen_or_none_nothing_is_closed(run: Path, seen: Seen | None) -> None:
    assert close_leases([URL], lambda _: seen, nobody, "jbclog safe") == []
    assert (read_leases(run), actions_in(run)) == ([LEASE, OTHER], [])


def test_a_run_that_goes_on_or_has_its_guard_there_closes_its_lease_itself(run: Path) -> None:
    assert close_leases([URL], lambda _: SAFE, lambda folder: folder == run, "jbclog safe") == []
    with guard_lock(run):
        assert close_leases([URL], lambda _: SAFE, nobody, "jbclog safe") == []
    assert close_leases(["/dev/no3"], lambda _: SAFE, nobody, "jbclog safe") == []
    assert (read_leases(run), actions_in(run)) == ([LEASE, OTHER], [])


def test_a_lease_stays_open_where_it_cannot_be_written_down_why_it_was_closed(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError("no space")

    patch(monkeypatch, "ActionLog._write", full)
    close_leases([URL], lambda _: SAFE, nobody, "jbclog safe")
    assert read_leases(run) == [LEASE, OTHER]


def test_a_folder_whose_lock_cannot_be_had_is_named_and_keeps_nobody(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_lock(*_: object) -> None:
        raise OSError(30, "Read-only file system")

    patch(monkeypatch, "open_leases.guard_lock", no_lock)
    settled = settle_leases(run.parent, [URL], nobody)
    assert settled == [LeftOver(False, settled[0].text)]
    assert "Run run left tools hot, and they could not be made safe: " in settled[0].text
    assert "Read-only file system" in settled[0].text


def may_not_be_read(folder: Path) -> bool:
    raise PermissionError(errno.EACCES, "Permission denied", folder)


@pytest.mark.parametrize("is_recording", [is_lock_held, may_not_be_read])
def test_a_run_whose_lock_is_no_file_or_may_not_be_read_keeps_nobody(
    run: Path, monkeypatch: pytest.MonkeyPatch, is_recording: IsRecording
) -> None:
    os.mkfifo(run / RUN_LOCK)
    seen = {LEASE: SAFE}
    assert close_leases([URL], seen.get, is_recording, "jbclog safe") == [run]
    patch(monkeypatch, "open_leases._take_over", lambda folder, *_: LeftOver(True, folder.name))
    assert settle_leases(run.parent, [OTHER.url], is_recording) == [LeftOver(True, "run")]
    (run / LEASES_FILE).write_text("{", encoding="utf-8")
    (left,) = settle_leases(run.parent, [OTHER.url], is_recording)
    assert left.text.endswith("Make them safe with `jbclog safe`, then remove that file.")


def test_a_lease_whose_folder_is_not_there_is_named_at_each_start_and_hides_no_other(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch(monkeypatch, "open_leases._settle", lambda folder, *_: LeftOver(True, folder.name))
    away = tmp_path / "disk" / "a"
    away.mkdir(parents=True)
    write_leases(away, [LEASE])
    away.parent.rename(tmp_path / "elsewhere")
    for _ in range(2):
        settled, not_known = settle_leases(run.parent, [URL], nobody)
        assert (settled, not_known.is_safe) == (LeftOver(True, "run"), False)
        assert not_known.text.startswith(f"{away} is not there, and its disk may not be mounted")
        assert not_known.text.endswith(
            "whether run a left tools hot is not known. Make them safe with `jbclog safe`."
        )


def test_leases_below_a_folder_are_found_also_behind_a_link(run: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    assert runs_below(tmp_path / "out" / "not there") == ([], [])
    assert runs_below(tmp_path / "out") == ([], [])
    (tmp_path / "out" / "verifications.jsonl").touch()
    (tmp_path / "out" / "gone").symlink_to("nowhere")
    (tmp_path / "out" / "linked").symlink_to(run)
    assert runs_below(tmp_path / "out") == ([run], [])


def test_a_guard_that_stays_is_not_waited_for_without_end(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch(monkeypatch, "open_leases.PATIENCE_S", 0.05)
    patch(monkeypatch, "open_leases.RETRY_S", 0.01)
    with guard_lock(run):
        assert settle_leases(run.parent, [URL], nobody) == []
    assert read_leases(run) == [LEASE, OTHER]


def test_of_many_leases_the_newest_are_settled_and_the_others_told(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Forged ones, with settings that no station answers to, would keep a start for minutes."""
    newer, open_run = run.with_name("run-2"), run.with_name("run-0")
    for folder in (newer, open_run):
        folder.mkdir()
        write_leases(folder, [LEASE])
    patch(monkeypatch, "open_leases.SETTLE_S", 0.05)

    def slow(folder: Path, *_: object) -> LeftOver:
        time.sleep(0.06)
        return LeftOver(True, folder.name)

    patch(monkeypatch, "open_leases._settle", slow)
    assert settle_leases(run.parent, [URL], lambda folder: folder == open_run) == [
        LeftOver(True, "run-2"),
        LeftOver(
            False,
            f"{run / 'lease.json'} had no turn within 0 s: whether run run left tools hot is not"
            " known. Make them safe with `jbclog safe`.",
        ),
    ]
