"""A run carries what it stood on, and is judged by it, from the file of verifications to the
manifest.
"""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pytest

from jbclog.app.run.options import Metadata
from jbclog.core.clock import VirtualClock
from jbclog.maintenance.verification import NAME, Given, keep, own_of, read_book, verify
from jbclog.record.check import check
from jbclog.record.manifest import Manifest, read_manifest
from support.virtual.recorded_run import run_in
from support.virtual.stepped_run import stepped_run
from support.virtual.virtual_run import RECIPE, line_text

ASKED = RECIPE + "\n[acceptance]\nverification_days = 30\n"


def run_of(home: Path, tips: tuple[str, ...] = ()) -> Manifest:
    line = line_text("joints_per_minute = 0\n", "ports = [1, 2]")
    return read_manifest(run_in(home, line, ASKED, 4.0, metadata=Metadata(tips=tips)))


def verified(home: Path, port: int, days_before: float, reading: float = 351.0) -> None:
    now = datetime.fromtimestamp(VirtualClock().utc(), UTC) - timedelta(days=days_before)
    given = Given("dde-1", port, reading, "TC-7", date(2099, 1, 1), "T-17", "A. Rossi")
    keep(home / "runs", verify(given, own_of([350.0] * 12, 350.0), now))


def rules(manifest: Manifest) -> dict[object, object]:
    return {
        rule["port"]: rule["result"]
        for rule in manifest.verdict_rules
        if rule["name"] == "verification"
    }


def test_each_port_cites_its_own_last_one(tmp_path: Path) -> None:
    verified(tmp_path, 1, 12)
    manifest = run_of(tmp_path)
    one, two = manifest.verifications
    assert (one.state, one.days, one.sha256) == (
        "pass",
        pytest.approx(12, abs=0.01),
        read_book(tmp_path / "runs").head,
    )
    assert (two.port, two.state) == (2, "none")
    assert rules(manifest) == {1: "pass", 2: "missing"}


def test_a_host_whose_clock_was_corrected_from_1970_cites_it_too(tmp_path: Path) -> None:
    verified(tmp_path, 1, 12)
    run = stepped_run(tmp_path, {2.0: VirtualClock().utc()}, {}, start_utc=5.0, recipe=ASKED)
    manifest = read_manifest(run)
    one, two = manifest.verifications
    assert (one.state, one.days) == ("pass", pytest.approx(12, abs=0.01))
    assert (two.port, two.state) == (2, "none")
    assert rules(manifest) == {1: "pass", 2: "missing"}
    assert check(run) == []


def test_a_bad_one_rejects_an_old_one_does_not_count(tmp_path: Path) -> None:
    verified(tmp_path, 1, 3, 400.0)
    verified(tmp_path, 2, 31)
    manifest = run_of(tmp_path)
    assert [one.state for one in manifest.verifications] == ["fail", "pass"]
    assert (rules(manifest), manifest.verdict) == ({1: "fail", 2: "missing"}, "REJECT")


def test_a_run_that_names_another_tip_does_not_stand_on_it(tmp_path: Path) -> None:
    verified(tmp_path, 1, 3)
    assert run_of(tmp_path, ("dde-1:1=T-18",)).verifications[0].state == "other tip"
    assert run_of(tmp_path, ("dde-1:1=T-17",)).verifications[0].state == "pass"


def test_a_file_that_cannot_be_believed_keeps_no_run_from_being_made(tmp_path: Path) -> None:
    verified(tmp_path, 1, 3)
    (tmp_path / "runs" / NAME).write_text("changed\n")
    manifest = run_of(tmp_path)
    assert {one.state for one in manifest.verifications} == {"unreadable"}
    assert manifest.verdict == "INCONCLUSIVE"


def test_a_line_that_a_run_cites_and_that_was_changed_or_is_gone_is_found_by_check(
    tmp_path: Path,
) -> None:
    verified(tmp_path, 1, 12)
    verified(tmp_path, 2, 11)
    run_of(tmp_path)
    (folder,) = (path for path in (tmp_path / "runs").iterdir() if path.is_dir())
    file = tmp_path / "runs" / NAME
    assert check(folder) == []
    verified(tmp_path, 1, 0)  # what comes behind changes nothing
    assert check(folder) == []
    first, second, third = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(first.replace(b"351.0", b"350.0") + second + third)
    (found,) = check(folder)
    assert str(found).startswith(
        "../verifications.jsonl: lacks the line that this run cites (dde-1 port 1)"
    )
    file.write_bytes(b"")
    assert len(check(folder)) == 2
    file.unlink()
    file.mkdir()
    assert "cannot be read" in str(*check(folder))
    file.rmdir()
    assert check(folder) == []  # taken elsewhere
