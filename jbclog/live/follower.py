"""Follows a run, or the newest run of a folder, for whoever shows it.

with jbclog.live.follow("runs") as line:
    for run in line.stream():
        for port in run.ports:
            print(port.station, port.port, port.condition, port.temperature)
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Final

from jbclog.core.clock import Clock
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import expect_answer
from jbclog.core.locks import commit_status
from jbclog.live.run_follower import RunFollower
from jbclog.live.states import RunState
from jbclog.record.folder import RUN_NAME
from jbclog.record.manifest import NAME as MANIFEST

EVERY_S: Final = 0.5  # a commit comes each 0.8 s, and nobody reads more than two states a second
COMMITS_S: Final = 10.0  # since its last commit a run counts as being recorded
MOST_RUNS: Final = 20  # the newest ones, among which a recorded one is searched for


class Follower:
    """Follows the run at `path`, or the newest run directly below it. Raises RecordError where
    `path` is no folder.

    Reads only, takes no lock, and may be stopped or killed at any step. Used by one thread at a
    time. `joints`: a process of lowest priority counts the joints of each port.
    """

    def __init__(
        self, path: str | os.PathLike[str], clock: Clock | None = None, *, joints: bool = False
    ) -> None:
        self.path = Path(path)
        self._clock, self._counts_joints = clock, joints
        self._run: RunFollower | None = None
        expect_answer(self.path)
        if not self.path.is_dir():
            raise RecordError(f"{self.path} does not exist, or is not a folder")
        self._is_run = is_run(self.path)

    def __enter__(self) -> Follower:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        if self._run is not None:
            self._run.close()
            self._run = None

    def poll(self) -> RunState | None:
        """Return the run as it is now; None while the folder has no run. A newer run of the folder
        takes the place of the last.
        """
        folder = self.path if self._is_run else current_run(self.path)
        if folder is not None and (self._run is None or self._run.folder != folder):
            self.close()
            self._run = RunFollower(folder, self._clock, joints=self._counts_joints)
        return None if self._run is None else self._run.poll()

    def stream(self, every_s: float = EVERY_S) -> Iterator[RunState]:
        """Yield the run again and again, `every_s` seconds apart."""
        while True:
            state = self.poll()
            if state is not None:
                yield state
            time.sleep(every_s)


def follow(path: str | os.PathLike[str] = "runs", *, joints: bool = False) -> Follower:
    """Return a follower of the run at `path`, or of the newest run below it. Raises RecordError.

    `joints`: count them too, in a process of lowest priority that ends with the follower.
    """
    return Follower(path, joints=joints)


def is_run(folder: Path) -> bool:
    """Whether a folder is a run, by its name or its content."""
    return (
        bool(RUN_NAME.fullmatch(Path(os.path.realpath(folder)).name))
        or (folder / MANIFEST).exists()
    )


def current_run(folder: Path) -> Path | None:
    """Return the newest run below `folder` that is being recorded, else the newest one, by their
    names; None without one.
    """
    try:
        with os.scandir(folder) as entries:
            names = [
                entry.name
                for entry in entries
                if RUN_NAME.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False)
            ]
    except OSError as error:
        raise RecordError(f"{folder} cannot be read: {error.strerror or error}") from error
    runs = [folder / name for name in sorted(names, reverse=True)[:MOST_RUNS]]
    return next(filter(_commits, runs), runs[0] if runs else None)


def _commits(run: Path) -> bool:
    since = commit_status(run).since
    return since is not None and abs(time.time() - since) < COMMITS_S
