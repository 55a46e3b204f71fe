"""A folder on a network mount that hangs is not waited for; a local one costs no child."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from jbclog.core.errors import RecordError
from jbclog.core.foreign import files
from jbclog.core.foreign.files import expect_answer
from jbclog.record.chains import previous_run
from jbclog.record.find_runs import find
from jbclog.record.folder import create_run
from jbclog.record.recover import recover_all


@pytest.fixture
def remote(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that the system is said to have mounted from a server."""
    folder = tmp_path / "on a server"
    folder.mkdir()
    place = str(folder).replace(" ", "\\040")
    (tmp_path / "mountinfo").write_text(
        f"36 35 98:0 / / rw - ext4 /dev/sda rw\n37 36 0:45 / {place} rw shared:1 - nfs4"
        " server:/runs rw\n"
    )
    monkeypatch.setattr(files, "MOUNTS", tmp_path / "mountinfo")
    return folder


@pytest.fixture
def hanging(remote: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same, and whoever looks there waits."""
    monkeypatch.setattr(files, "LOOK", "import time; time.sleep(60)")
    monkeypatch.setattr(files, "ANSWERS_S", 0.3)
    return remote


@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
def test_one_that_hangs_is_a_sentence_for_all_who_look_there(hanging: Path, tmp_path: Path) -> None:
    (tmp_path / "runs").symlink_to("on a server/below")
    began = time.monotonic()
    for look in (
        lambda: expect_answer(hanging),
        lambda: expect_answer(tmp_path / "runs"),
        lambda: list(find(hanging)),
        lambda: recover_all(hanging),
        lambda: previous_run(hanging, "bench"),
        lambda: create_run(hanging, "bench", 1.79e9),
    ):
        with pytest.raises(
            RecordError, match=r"does not answer within 0\.3 s: its network mount hangs"
        ):
            look()
    assert time.monotonic() - began < 20


def test_one_that_answers_is_read(remote: Path) -> None:
    expect_answer(remote)
    expect_answer(remote / "not there")
    assert list(find(remote)) == []


def test_a_local_folder_is_asked_by_nobody_else(hanging: Path, tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    for folder in (tmp_path, tmp_path / "not there", tmp_path / "loop" / "x", Path()):
        expect_answer(folder)
