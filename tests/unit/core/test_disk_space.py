"""Why a write failed: no inodes, or what the system says."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.doctor import look_at_folder
from jbclog.core.disk_space import write_failure, write_failure_below
from jbclog.core.durable_files import write_whole
from support.faults.small_disk import fill, small_disk, take_inodes


def failed_write(path: Path) -> OSError:
    with pytest.raises(OSError) as failed:  # noqa: PT011  # which one is looked at
        write_whole(path, b"1" * 4096)
    return failed.value


def test_no_inodes_are_named_with_the_disk(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "4m", 12) as disk:
        runs = disk / "runs"
        runs.mkdir()
        take_inodes(disk)
        text = f"no inodes left on the disk at {disk} (`df -i`); remove old files from it"
        error = failed_write(runs / "file")
        assert write_failure(error, runs / "absent" / "file") == text
        assert write_failure_below(error, runs) == text
        (found,) = look_at_folder(runs)
        assert found.kind == "disk.no_write"
        assert text in found.what


def test_a_full_disk_is_named_as_such_and_other_refusals_by_the_system(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "2m", 1000) as disk:
        fill(disk)
        error = failed_write(disk / "file")
        assert write_failure(error, disk) == "the disk is full: No space left on device"
        assert write_failure_below(error, disk).startswith("the disk is full: [Errno 28] No space")
    missing = failed_write(tmp_path / "absent" / "file")
    assert write_failure(missing, tmp_path) == "No such file or directory"


def test_doctor_names_few_inodes(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "600m", 12) as disk:
        (found,) = look_at_folder(disk / "runs")
    assert (found.kind, found.what) == (
        "disk.inodes",
        "the disk has fewer than 16 inodes left; a run needs more",
    )
