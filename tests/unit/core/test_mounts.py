"""A folder on a network mount that hangs is not waited for; a local one costs no child."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from jbclog.app.index.index_file import IndexFile
from jbclog.app.index.run_index import RunIndex
from jbclog.app.watch.past_runs import past_runs
from jbclog.core import files
from jbclog.core.errors import RecordError
from jbclog.core.files import expect_answer
from jbclog.record.chains import previous_run
from jbclog.record.find_runs import Found, Unreadable, find
from jbclog.record.folder import create_run
from jbclog.record.manifest import Manifest, RunState, write_manifest
from jbclog.record.recover import recover_all
from support.command import until

HANGS_S = 200.0


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
    monkeypatch.setattr(files, "ANSWERS_S", 100.0)  # a child may be slow to start
    return folder


@pytest.fixture
def hanging(remote: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same, and whoever looks there waits."""
    monkeypatch.setattr(files, "LOOK", f"import time; time.sleep({HANGS_S})")
    monkeypatch.setattr(files, "ANSWERS_S", 0.3)
    return remote


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
    assert time.monotonic() - began < HANGS_S  # no child is waited for


def test_the_child_that_looked_is_reaped_when_it_ends(
    hanging: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    children: list[subprocess.Popen[bytes]] = []

    class Child(subprocess.Popen[bytes]):
        def __init__(self, command: list[str], **how: Any) -> None:
            super().__init__(command, **how)
            children.append(self)

    monkeypatch.setattr(subprocess, "Popen", Child)
    with pytest.raises(RecordError):
        expect_answer(hanging)
    assert until(lambda: children[0].returncode is not None)


def test_of_what_an_automounter_made_the_folder_of_the_run_is_asked(
    hanging: Path, tmp_path: Path
) -> None:
    """Its own mount answers while a server below it hangs."""
    with (tmp_path / "mountinfo").open("a") as mounts:
        mounts.write(f"38 36 0:46 / {tmp_path}/net rw - autofs -hosts rw\n")
        mounts.write(f"39 38 0:47 / {tmp_path}/net/nas rw - nfs4 nas:/ rw\n")
    for name, asked in (("net/nas/runs/one", "net/nas/runs"), ("net/nas", "net/nas")):
        why = f"{tmp_path / asked} does not answer within 0.3 s: its network mount hangs"
        assert files.why_hangs(tmp_path / name) == why


def test_a_link_to_one_that_hangs_is_a_finding_in_its_place(hanging: Path, tmp_path: Path) -> None:
    """It blocks no other run of its folder."""
    home = tmp_path / "home"
    run = home / "20261121T013001Z-bench-abcd"
    run.mkdir(parents=True)
    write_manifest(run, Manifest(run.name, state=RunState.SEALED))
    links = [home / "20261121T013000Z-bench-abcd", home / "renamed"]
    for link in links:
        link.symlink_to(hanging / link.name)
    why = f"{hanging} does not answer within 0.3 s: its network mount hangs"
    began = time.monotonic()
    for source in (find, RunIndex(IndexFile(None)).find):
        found = {one.folder: one for one in source(home)}
        assert isinstance(found.pop(run), Found)
        assert found == {link: Unreadable(link, why) for link in links}
    refused = {one.folder: one.text for one in recover_all(home)}
    assert [refused[link] for link in links] == [
        f"{link}: {why}; nothing was changed" for link in links
    ]
    assert {"name": links[0].name, "text": "not readable", "report": False} in past_runs(home)
    assert time.monotonic() - began < 20


def test_a_link_to_one_that_answers_is_followed(remote: Path, tmp_path: Path) -> None:
    run = remote / "20261121T013001Z-bench-abcd"
    run.mkdir()
    write_manifest(run, Manifest(run.name, state=RunState.SEALED))
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / run.name).symlink_to(run)
    (found,) = find(tmp_path / "home")
    assert isinstance(found, Found)
    assert files.why_link_hangs(run) is None  # it is no link


def test_one_that_answers_is_read(remote: Path) -> None:
    expect_answer(remote)
    expect_answer(remote / "not there")
    assert list(find(remote)) == []


def test_a_local_folder_is_asked_by_nobody_else(hanging: Path, tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    for folder in (tmp_path, tmp_path / "not there", tmp_path / "loop" / "x", Path()):
        expect_answer(folder)
