"""Publishes the sealed runs of a folder: once, or as they are sealed while a line runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.app.publish.publisher import Outcome, Publisher
from jbclog.core.errors import RecordError
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.find_runs import SEALED, Found, find
from jbclog.record.manifest import NAME as MANIFEST

NOT_SEALED: Final = "is not sealed: it is being recorded, or it crashed; then run `jbclog recover`"


@dataclass(frozen=True, slots=True)
class Skipped:
    """A folder that was not published, and why. A run that is still open is no failure."""

    folder: Path
    why: str
    is_open: bool = False

    def __str__(self) -> str:
        return self.why if self.why.startswith(str(self.folder)) else f"{self.folder}: {self.why}"


def publish_all(publisher: Publisher, folder: Path) -> Iterator[Outcome | Skipped]:
    """Publish the sealed runs directly below `folder`, or `folder` itself; yield what became of each. One run blocks no other."""
    for one in find(folder):
        if not isinstance(one, Found):
            yield Skipped(one.folder, one.why)
        elif one.state != SEALED:
            yield Skipped(one.folder, NOT_SEALED, is_open=True)
        else:
            yield _published(publisher, one.folder)


def _published(publisher: Publisher, folder: Path) -> Outcome | Skipped:
    try:
        return publisher.publish(folder)
    except RecordError as error:
        return Skipped(folder, str(error))


class Follower:
    """Publishes what is sealed, or annotated, since it was asked last."""

    def __init__(self, publisher: Publisher, folder: Path) -> None:
        self._publisher, self._folder = publisher, folder
        self._seen: dict[Path, tuple[object, ...]] = {}

    def poll(self) -> Iterator[Outcome | Skipped]:
        """Yield what became of each sealed run that is new or changed. What failed is tried again when its files change.

        Raises `RecordError` where the folder cannot be read.
        """
        self._publisher.renew()
        for path in sorted(self._folder.iterdir()) if self._folder.is_dir() else ():
            now = _state(path)
            if now and now != self._seen.get(path):
                yield from self._look(path, now)

    def _look(self, path: Path, now: tuple[object, ...]) -> Iterator[Outcome | Skipped]:
        for one in publish_all(self._publisher, path):
            if isinstance(one, Skipped) and one.is_open:
                return
            self._seen[path] = now
            yield one


def _state(folder: Path) -> tuple[object, ...]:
    """Return what changes when a run is sealed or annotated; empty without a manifest."""
    found = []
    for name in (MANIFEST, ANNOTATIONS):
        try:
            file = (folder / name).stat()
        except OSError:
            if name == MANIFEST:
                return ()
            continue
        found.append((name, file.st_ino, file.st_mtime_ns, file.st_size))
    return tuple(found)
