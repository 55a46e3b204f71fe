"""Tools that a dead recorder may have left hot: told in the record, in its exit status, and to
whoever recovers it.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.core.rows import StationFacts
from jbclog.guard.action_log import ActionLog
from jbclog.guard.open_leases import settle
from jbclog.live import follow
from jbclog.record import conclude
from jbclog.record import conclude as concluding
from jbclog.record.check import check
from jbclog.record.cross_check import uncovered
from jbclog.record.guard_actions import ACTION_LOG as DIARY
from jbclog.record.guard_actions import LEASE
from jbclog.record.manifest import Manifest, read_manifest, write_manifest
from jbclog.record.parts import row_groups
from jbclog.record.recover import Outcome, recover
from support.invoked import invoked
from support.records import few_rows

TOUCHED = replace(few_rows.facts(), touched=[1, 2], asked_safe_state="stand")
FEEDS = replace(TOUCHED, touched=[1], may_feed=True)
SEEN = "Last read 352 °C at 14:13:34 UTC; it may be hot."
DIED = (
    "Whether the tool was made safe is not known: recorder and guard ended, or could not write it"
    " down."
)

Left = Callable[..., Path]


@pytest.fixture
def left(tmp_path: Path) -> Left:
    """A run that was cut off with these facts, and with this lease open."""

    def make(facts: StationFacts, *leases: dict[str, object], guard: str = "on") -> Path:
        store = few_rows.begun(tmp_path)
        write_manifest(
            store.folder,
            Manifest(run=store.folder.name, guard=guard, stations=[replace(facts, touched=[])]),
        )
        store.facts(facts)
        few_rows.hand_over(store, range(150))
        store.commit_now()
        few_rows.vanish(store)
        if leases:
            (store.folder / LEASE).write_text("".join(json.dumps(lease) + "\n" for lease in leases))
        return store.folder

    return make


def lease(*ports: int, feeds: bool = False) -> dict[str, object]:
    return {"name": "a", "ports": ports, "feeds": feeds}


def told(folder: Path) -> list[tuple[int | None, str, float | None]]:
    """The events that say so."""
    rows = [
        row
        for group in row_groups(folder, "events")
        for row in group.to_pylist()
        if row["kind"] == conclude.KIND
    ]
    assert {row["severity"] for row in rows} <= {"critical"}
    return [(row["port"], row["text"], row["value"]) for row in rows]


def test_a_lease_that_nobody_closed_is_told_port_by_port_with_what_was_last_read(
    left: Left,
) -> None:
    folder = left(TOUCHED, lease(1, 2))
    done = recover(folder)
    assert told(folder) == [
        (1, f"{DIED} {SEEN}", 352.0),
        (2, f"{DIED} It was never read; it may be hot.", None),
    ]
    assert not done.is_safe
    assert "Tools of a may still be hot: their safe state is not confirmed." in done.text
    manifest = read_manifest(folder)
    assert (manifest.exit_status, manifest.exit_code) == ("lost", 5)
    assert manifest.stations[0].unsafe == [
        f"a port {port}: {text}" for port, text, _ in told(folder)
    ]
    assert check(folder) == []


def test_what_was_touched_is_told_although_no_lease_could_be_kept(left: Left) -> None:
    assert [port for port, _, _ in told(recover(left(TOUCHED)).folder)] == [1, 2]


@pytest.mark.parametrize(
    "made",
    [
        lambda path: os.mkfifo(path),
        lambda path: path.write_bytes(b"\xff{torn"),
        lambda path: path.mkdir(),
    ],
)
def test_a_lease_that_cannot_be_read_is_no_closed_one(
    left: Left, made: Callable[[Path], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it named is not known; the tools that were touched are told, and the next start of the
    line says it as well.
    """
    # other tests leave leases that cannot be read
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folder = left(TOUCHED)
    made(folder / LEASE)
    done = recover(folder)
    assert [port for port, _, _ in told(folder)] == [1, 2]
    assert not done.is_safe
    assert "lease.json cannot be read (" in done.text
    assert "which tools of this run may still be hot is not known" in done.text
    assert invoked("recover", folder).exit_code == 5
    (found,) = settle(folder.parent, {"nowhere"}, lambda _: False)
    assert not found.is_safe
    assert f"whether run {folder.name} left tools hot is not known" in found.text


def test_without_a_guard_that_is_the_reason(left: Left) -> None:
    folder = recover(left(TOUCHED, guard="none")).folder
    assert told(folder)[0][1].startswith(
        "Whether the tool was made safe is not known: the recorder ended, and there was no guard."
    )


def test_a_diary_that_was_cut_short_leaves_the_others_unknown(left: Left) -> None:
    """As on a disk that takes no more: the lease stays open then."""
    folder = left(TOUCHED, lease(1, 2))
    ActionLog(folder).write(
        "safety.safe_state", "info", "The tool was put in its safe state.", "a", 1
    )
    assert not recover(folder).is_safe
    assert [port for port, _, _ in told(folder)] == [2]


# -- a guard that was killed after it had made the tools safe and before it closed the lease -------


def logged_safe(folder: Path, *ports: int) -> None:
    for port in ports:
        ActionLog(folder).write(
            "safety.safe_state", "info", "The tool was put in its safe state.", "a", port
        )


def test_what_the_guard_logged_as_safe_is_known_although_its_lease_is_open(left: Left) -> None:
    """Recovering, the record, the view of it and its check agree; the lease stays for the next
    start.
    """
    folder = left(TOUCHED, lease(1, 2))
    logged_safe(folder, 1, 2)
    done = recover(folder)
    assert (done.is_safe, told(folder), read_manifest(folder).exit_code) == (True, [], 4)
    assert read_manifest(folder).stations[0].safe_state == {1: "verified", 2: "verified"}
    assert check(folder) == []
    assert [name for name, _ in uncovered(folder, None)] == [LEASE]
    assert invoked("recover", folder).exit_code == 0
    with follow(folder) as follower:
        assert not any("may still be hot" in one for one in follower.poll().problems)
    assert conclude.left_leases(folder)["a"].ports == (1, 2)


def older_than_a_reading(folder: Path) -> None:
    """The guard's line is older than the recorder's last reading of the tool of port 1."""
    text = (folder / DIARY).read_text()
    (folder / DIARY).write_text(
        "".join(f"{json.dumps(json.loads(one) | {'time': 1})}\n" for one in text.split("\n") if one)
    )
    os.utime(folder / LEASE, (0, 0))


def newer_lease(folder: Path) -> None:
    later = time.time() + 60
    os.utime(folder / LEASE, (later, later))


def taken_line(folder: Path) -> None:
    lines = [one for one in (folder / DIARY).read_text().split("\n") if one]
    (folder / DIARY).write_text(f"{lines[1]}\n")


def later_failure(folder: Path) -> None:
    ActionLog(folder).write(
        "safety.not_safe", "critical", "The tool could not be made safe.", "a", 1
    )


@pytest.mark.parametrize(
    ("spoil", "hot"),
    [(older_than_a_reading, [1]), (newer_lease, [1, 2]), (taken_line, [1]), (later_failure, [])],
    ids=["older than a reading", "newer lease", "a line missing", "failed later"],
)
def test_what_the_guard_did_not_log_last_stays_not_known(
    left: Left, spoil: Callable[[Path], None], hot: list[int]
) -> None:
    folder = left(TOUCHED, lease(1, 2))
    logged_safe(folder, 1, 2)
    spoil(folder)
    done = recover(folder)
    assert "Tools of a may still be hot" in done.text
    assert ([port for port, _, _ in told(folder)], read_manifest(folder).exit_code) == (hot, 5)
    assert not read_manifest(folder).stations[0].safe_state.keys() & {*hot}
    assert check(folder) == []
    assert invoked("recover", folder).exit_code == 5


def test_a_tool_that_the_recorder_itself_made_safe_before_both_were_killed_is_known(
    left: Left,
) -> None:
    folder = left(replace(TOUCHED, safe_state={1: "verified", 2: "verified"}), lease(1, 2))
    assert (recover(folder).is_safe, check(folder)) == (True, [])


def test_a_lease_of_a_recorder_that_ended_needs_the_guards_lines(left: Left) -> None:
    """Such a recorder closes its lease: another one in its folder is a disagreement."""
    folder = left(
        replace(TOUCHED, outcome="completed", safe_state={1: "verified", 2: "verified"}), lease(1)
    )
    assert "Tools of a may still be hot" in recover(folder).text
    assert [str(one) for one in check(folder)] == [
        "lease.json: names a as possibly hot; the manifest does not"
    ]


@pytest.mark.parametrize(
    ("facts", "leases", "hot"),
    [
        (FEEDS, [], [1, None]),
        (FEEDS, [lease(1)], [1, None]),
        (replace(FEEDS, may_feed=False), [lease(feeds=True)], [1, None]),
        (replace(TOUCHED, safe_state={1: "verified", 2: "verified"}), [], []),
        (
            replace(
                TOUCHED,
                outcome="completed",
                safe_state={1: "verified", 2: "failed"},
                unsafe=["a port 2: hot"],
            ),
            [],
            [],
        ),
        (replace(TOUCHED, asked_safe_state=""), [], []),  # an OMEGA has none
        (few_rows.facts(), [], []),
    ],
    ids=["feeder", "held", "feeder held", "made safe", "told", "none", "untouched"],
)
def test_what_is_known_is_not_told_again(
    left: Left, facts: StationFacts, leases: list[dict[str, object]], hot: list[int | None]
) -> None:
    folder = left(facts, *leases)
    recover(folder)
    assert [port for port, _, _ in told(folder)] == hot
    assert read_manifest(folder).exit_code == (5 if hot or facts.unsafe else 4)


def test_a_take_over_that_did_all_is_a_lost_run_and_no_unsafe_one(left: Left) -> None:
    folder = left(FEEDS)
    action_log = ActionLog(folder)
    action_log.reserve()
    action_log.write("safety.safe_state", "info", "The tool was put in its safe state.", "a", 1)
    action_log.write("guard.took_over", "error", "The guard took over.")
    done = recover(folder)
    assert (done.is_safe, told(folder), read_manifest(folder).exit_code) == (True, [], 4)
    assert len((folder / DIARY).read_bytes().splitlines()) == 2  # its room is given back
    assert check(folder) == []


def test_a_diary_that_was_never_needed_is_no_part_of_the_record(left: Left) -> None:
    folder = left(few_rows.facts())
    ActionLog(folder).reserve()
    recover(folder)
    assert not (folder / DIARY).exists()


def test_a_recovery_that_is_cut_off_and_done_again_tells_it_once(
    left: Left, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = left(TOUCHED, lease(1, 2))

    def torn(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(concluding, "write_manifest", torn)
        with pytest.raises(KeyboardInterrupt):
            recover(folder)
    recover(folder)
    assert [port for port, _, _ in told(folder)] == [1, 2]
    assert check(folder) == []


# -- whoever recovers it ---------------------------------------------------------------------------


def test_recover_ends_with_5_until_the_lease_is_closed(left: Left) -> None:
    folder = left(TOUCHED, lease(1, 2))
    codes = [invoked("recover", folder) for _ in range(2)]
    assert [ended.exit_code for ended in codes] == [5, 5]
    assert "already finished; nothing was changed." in codes[1].stdout
    assert "Tools of a may still be hot" in codes[1].stdout
    (folder / LEASE).unlink()
    ended = invoked("recover", folder, "--json")
    assert ended.exit_code == 0
    (run,) = json.loads(ended.stdout)["runs"]
    assert (run["outcome"], run["safe"]) == (Outcome.WHOLE, True)


def test_recover_ends_with_5_where_the_guard_could_not_make_a_tool_safe(left: Left) -> None:
    folder = left(TOUCHED, lease(2))
    action_log = ActionLog(folder)
    action_log.write("safety.safe_state", "info", "The tool was put in its safe state.", "a", 1)
    action_log.write("safety.not_safe", "critical", "The tool could not be made safe.", "a", 2)
    assert invoked("recover", folder).exit_code == 5
    assert (told(folder), read_manifest(folder).exit_code) == ([], 5)


@pytest.mark.parametrize("stands_in", ["a pipe", "a folder", "a link"])
def test_a_guards_log_that_cannot_be_read_confirms_no_tool(tmp_path: Path, stands_in: str) -> None:
    """`watch` asks twice a second; the error would end it."""
    (tmp_path / "lease.json").write_text('{"name": "dde-1", "ports": [1]}\n')
    log = tmp_path / "guard.jsonl"
    {
        "a pipe": lambda: os.mkfifo(log),
        "a folder": log.mkdir,
        "a link": lambda: log.symlink_to("/dev/zero"),
    }[stands_in]()
    facts = StationFacts("dde-1", "/dev/dde-1", "dde", ports=[1])
    assert conclude.hot_warning(tmp_path, [facts]) == (
        "Tools of dde-1 may still be hot: their safe state is not confirmed. `jbclog safe`, or a"
        " new run on their ports, makes them safe."
    )
