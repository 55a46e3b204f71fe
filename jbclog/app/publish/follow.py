"""Publishes runs as they are sealed, for days, through outages of the store.

An error of the store (`StoreError`) is not the run's: the run is tried again after a growing pause,
and the trouble is reported once. A run that is refused is tried again when one of its files
changes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.app.publish.folder import Skipped, publish_all
from jbclog.app.publish.publisher import Outcome, Publisher
from jbclog.core.errors import StoreError
from jbclog.core.files import entries_below
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.manifest import NAME as MANIFEST

LOOK_EVERY_S: Final = 5.0
LONGEST_PAUSE_S: Final = 60.0

State = tuple[object, ...]


@dataclass(frozen=True, slots=True)
class Trouble:
    """The store, or the folder of the runs, cannot be reached, or can again. Reported once."""

    text: str

    def __str__(self) -> str:
        return self.text


class Follower:
    """Publishes runs sealed or annotated since the last `poll`; poll again after `pause_s`."""

    def __init__(self, publisher: Publisher, folder: Path) -> None:
        self._publisher, self._folder = publisher, folder
        self._seen: dict[Path, tuple[Callable[[Path], State], State]] = {}
        self._failed: Counter[Path] = Counter()
        self._is_lost, self._is_reported = False, False
        self.pause_s = LOOK_EVERY_S

    def poll(self) -> Iterator[Outcome | Skipped | Trouble]:
        """Yield the outcome of each new or changed sealed run, and trouble when it begins and ends.

        Raises `UsageError` if a store that was lost comes back as one where commits are not safe.
        """
        try:
            if self._is_lost:
                self._publisher.reopen()
            self._publisher.renew()
            yield from self._changed()
        except StoreError as error:
            yield from self._report_lost(
                f"{error}; what is left is tried again until it is published"
            )
        except OSError as error:
            yield from self._report_lost(
                f"{self._folder} cannot be read: {error.strerror or error}; it is tried again"
            )
        else:
            self._is_lost, self.pause_s = False, LOOK_EVERY_S
            yield from self._report_back()

    def _changed(self) -> Iterator[Outcome | Skipped | Trouble]:
        """Publish changed runs; one at which the store failed comes last, so that it blocks no
        other.
        """
        for path in sorted(self._folder.iterdir(), key=lambda path: (self._failed[path], path)):
            look, before = self._seen.get(path, (_state, ()))
            now = look(path)
            if now and now != before:
                yield from self._publish(path)

    def _publish(self, path: Path) -> Iterator[Outcome | Skipped | Trouble]:
        before = {look: look(path) for look in (_state, _all_files)}
        self._failed[path] += 1
        for one in publish_all(self._publisher, path):
            if isinstance(one, Skipped) and one.is_open:
                break
            look = _all_files if isinstance(one, Skipped) else _state
            if _state(path):  # otherwise its folder is gone, too
                self._seen[path] = look, before[look]
            if isinstance(one, Outcome):
                yield from self._report_back()
            yield one
        del self._failed[path]

    def _report_lost(self, text: str) -> Iterator[Trouble]:
        self.pause_s = min(2 * self.pause_s, LONGEST_PAUSE_S)
        self._is_lost = True
        if not self._is_reported:
            self._is_reported = True
            yield Trouble(text)

    def _report_back(self) -> Iterator[Trouble]:
        if self._is_reported:
            self._is_reported = False
            yield Trouble(f"{self._publisher.place} is written again")


def _state(folder: Path) -> State:
    """Return a value that changes when a run is sealed or annotated; empty without a manifest."""
    found = [_facts(folder / name) for name in (MANIFEST, ANNOTATIONS)]
    return tuple(found) if found[0] else ()


def _all_files(folder: Path) -> State:
    """Return a value that changes when a refused run is repaired; empty if not known."""
    try:
        paths = sorted(
            entry.path for entry in entries_below(folder) if not entry.is_dir(follow_symlinks=False)
        )
    except OSError:
        return ()
    return tuple((path, _facts(Path(path))) for path in paths)


def _facts(file: Path) -> State:
    try:
        found = file.lstat()
    except OSError:
        return ()
    return found.st_ino, found.st_mtime_ns, found.st_size
