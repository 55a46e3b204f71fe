"""What somebody put into the folder of a batch is not written to, and nobody waits for it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from jbclog.app.batch.job_dir import LOCK, NOTES, JobDir
from jbclog.app.batch.single_batch import hold
from jbclog.core.errors import RecordError


def _link(path: Path) -> None:
    path.symlink_to("elsewhere")


KINDS: dict[str, tuple[Callable[[Path], None], str]] = {
    "pipe": (os.mkfifo, "is a pipe, not a file|No such device"),
    "link": (_link, "Too many levels of symbolic links"),
    "folder": (Path.mkdir, "Is a directory"),
}


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> tuple[Callable[[Path], None], str]:
    return KINDS[request.param]


def test_output_of_a_job_is_appended_to_its_file_only(
    tmp_path: Path, kind: tuple[Callable[[Path], None], str]
) -> None:
    job = JobDir(tmp_path / "jobs" / "night-1")
    job.folder.mkdir(parents=True)
    for text in (b"one\n", b"two\n"):
        with job.notes() as notes:
            notes.write(text)
    assert (job.folder / NOTES).read_bytes() == b"one\ntwo\n"
    assert job.last_note() == "two"
    (job.folder / NOTES).unlink()
    make, said = kind
    make(job.folder / NOTES)
    with pytest.raises(OSError, match=said):
        job.notes()
    assert not (job.folder / "elsewhere").exists()


def test_a_job_whose_lock_is_no_file_does_not_run(tmp_path: Path) -> None:
    job = JobDir(tmp_path / "jobs" / "night-1")
    job.folder.mkdir(parents=True)
    assert not job.is_running()
    os.mkfifo(job.folder / LOCK)
    assert not job.is_running()


def test_a_lock_that_is_no_file_starts_nothing(
    tmp_path: Path, kind: tuple[Callable[[Path], None], str]
) -> None:
    make, said = kind
    jobs, home = tmp_path / "jobs.toml", tmp_path / "jobs.batch"
    jobs.write_text("")
    home.mkdir()
    make(home / LOCK)
    with (
        pytest.raises(RecordError, match=f"cannot be created or locked: ({said}); nothing was"),
        hold(home, jobs, "now"),
    ):
        pass
    assert not (home / "elsewhere").exists()
