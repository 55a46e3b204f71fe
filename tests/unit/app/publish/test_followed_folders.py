"""What a follower does with folders that are no run of a recorder."""

from __future__ import annotations

from pathlib import Path
from typing import cast

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
