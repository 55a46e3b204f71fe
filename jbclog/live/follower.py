"""Follows a run, or the newest run of a folder.

::

    with jbclog.live.follow("runs") as follower:
        for run in follower.stream():
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
from jbclog.live.run_follower import RunFollower
from jbclog.live.states import RunState
from jbclog.record.folder import RUN_NAME
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.segments import segments

EVERY_S: Final = 0.5  # the recorder commits every 0.6 s
GROWS_S: Final = 10.0  # a run whose journal grew this recently counts as being recorded
MOST_RUNS: Final = 20  # newest runs that are searched for one being recorded


class Follower:
    """Follow the run at `path`, or the newest run directly below it.

    Reads only, takes no lock, and may be stopped or killed at any step. Not thread-safe. `joints`
    starts a process of the lowest priority that counts the joints of each port.

    Raises `RecordError` if `path` is not a folder.
    """

    def __init__(
        self, path: str | os.PathLike[str], clock: Clock | None = None, *, joints: bool = False
    ) -> None:
        self.path = Path(path)
        self._clock, self._counts_joints = clock, joints
        self._run: RunFollower | None = None
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
        """Return the current state of the run, or None while the folder has no run.

        Switches to a newer run of the folder as soon as there is one.
        """
        folder = self.path if self._is_run else current_run(self.path)
        if self._run is None or (folder is not None and self._run.folder != folder):
            if folder is None:
                return None
            self._run = self._begun(folder)
        state = self._run.poll()
        if self._run.was_replaced():
            self._run = self._begun(self._run.folder)
            state = self._run.poll()
        return state

    def _begun(self, folder: Path) -> RunFollower:
        self.close()
        return RunFollower(folder, self._clock, joints=self._counts_joints)

    def stream(self, every_s: float = EVERY_S) -> Iterator[RunState]:
        """Yield the state of the run every `every_s` seconds, without end."""
        while True:
            state = self.poll()
            if state is not None:
                yield state
            time.sleep(every_s)


def follow(path: str | os.PathLike[str] = "runs", *, joints: bool = False) -> Follower:
    """Return a follower of the run at `path`, or of the newest run below it.

    `joints` also counts joints, in a process of the lowest priority that ends with the follower.
    Raises `RecordError` if `path` is not a folder.
    """
    return Follower(path, joints=joints)


def is_run(folder: Path) -> bool:
    """Return whether a folder is a run, by its name or its content."""
    return (
        bool(RUN_NAME.fullmatch(Path(os.path.realpath(folder)).name))
        or (folder / MANIFEST).exists()
    )


def current_run(folder: Path) -> Path | None:
    """Return the newest run below `folder` that is being recorded, else the newest by name, else
    None.
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
    return next(filter(_is_growing, runs), runs[0] if runs else None)


def _is_growing(run: Path) -> bool:
    try:
        written_s = segments(run)[-1].stat().st_mtime
    except (OSError, IndexError):
        return False
    return abs(time.time() - written_s) < GROWS_S
