"""What a follower does with folders that are no run of a recorder."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import pytest

from jbclog.app.publish import follow
from jbclog.app.publish.folder import Skipped
from jbclog.app.publish.follow import Follower
from jbclog.app.publish.publisher import Publisher
from jbclog.core.errors import RecordError
from jbclog.record.manifest import Manifest, RunState, write_manifest
from support.faults.deep_folder import deep_folder


class Refusing:
    """A publisher that takes no run."""

    def renew(self) -> None:
        """There is no lease."""

    def publish(self, folder: Path) -> None:
        raise RecordError(f"{folder} is not whole")


def test_folders_in_one_another_end_no_follower(tmp_path: Path) -> None:
    """They are no run, and are tried again when something of them changes."""
    run = tmp_path / "20261121T013000Z-bench-abcd"
    run.mkdir()
    write_manifest(run, Manifest(run.name, state=RunState.SEALED))
    follower = Follower(cast("Publisher", Refusing()), tmp_path)
    with deep_folder(run):
        assert [*follower.poll()] == [Skipped(run, f"{run} is not whole")]
        assert [*follower.poll()] == []
    assert [*follower.poll()] == [Skipped(run, f"{run} is not whole")]
    assert [*follower.poll()] == []


def test_a_link_to_a_network_mount_that_hangs_is_told_once_and_tried_when_it_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, link = (tmp_path / place / "20261121T013000Z-bench-abcd" for place in ("away", "runs"))
    for folder in (run, link.parent):
        folder.mkdir(parents=True)
    write_manifest(run, Manifest(run.name, state=RunState.SEALED))
    link.symlink_to(run)
    hanging = {link: "it hangs"}
    monkeypatch.setattr(follow, "why_link_hangs", hanging.get)
    follower = Follower(cast("Publisher", Refusing()), link.parent)
    assert [*follower.poll()] == [Skipped(link, "it hangs")]
    assert [*follower.poll()] == []
    hanging.clear()
    assert [*follower.poll()] == [Skipped(link, f"{link} is not whole")]


def test_a_link_in_a_run_is_not_followed(tmp_path: Path) -> None:
    """It may lead to a network mount that hangs. Where it leads to changes nothing of the run."""
    run = tmp_path / "runs" / "20261121T013000Z-bench-abcd"
    run.mkdir(parents=True)
    write_manifest(run, Manifest(run.name, state=RunState.SEALED))
    (tmp_path / "notes").write_text("x")
    (run / "notes").symlink_to(tmp_path / "notes")
    follower = Follower(cast("Publisher", Refusing()), run.parent)
    assert [*follower.poll()] == [Skipped(run, f"{run} is not whole")]
    (tmp_path / "notes").write_text("other")
    assert [*follower.poll()] == []
