"""Sealing that stops before a chosen step, and reading in the middle of which a run is sealed.

A step of sealing is whatever others can see: a rename or a removal. A step of reading is whatever
it asks of the disk by
itself: the list of the store's files, opening one, fixing the moment, each query, the list of
parts, the manifest.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from jbclog.analysis import run_tables
from jbclog.core.locks import FolderLock
from jbclog.record import store_reader as stock_module
from jbclog.record.conclude import conclude
from jbclog.record.manifest import read_manifest
from jbclog.record.seal import seal_rows
from jbclog.record.store import Segment

READING = ("list", "open", "opened", "moment", "begun", "notes", "index", "manifest", "parts")


class Cut(BaseException):
    """The sealing stops here, as by a kill."""


@dataclass
class Sealing:
    """Seals the run in `folder` until just before its step `until`; None: to the end. `told`: the
    steps that were done.
    """

    folder: Path
    until: int | None = None
    told: list[str] = field(default_factory=list)

    def __call__(self) -> None:
        lock = FolderLock.take(self.folder)
        try:
            with pytest.MonkeyPatch.context() as patch:
                for name in ("replace", "unlink"):
                    patch.setattr(os, name, self._counted(getattr(os, name)))
                seal_rows(self.folder)
                conclude(self.folder, read_manifest(self.folder), lock)
        except Cut:
            pass
        finally:
            lock.release()

    def _counted(self, real: Callable[..., None]) -> Callable[..., None]:
        def step(path: Path, *more: object, **names: object) -> None:
            if len(self.told) == self.until:
                raise Cut
            if Path(path).exists():  # to remove what is not there is no step
                self.told.append(f"{real.__name__} {Path(path).name}")
            real(path, *more, **names)

        return step


@contextmanager
def meanwhile(step: str, act: Callable[[], None]) -> Iterator[list[str]]:
    """Whoever reads inside does `act` just before its first `step` (``opened``: just after
    opening); gives the steps it did.
    """
    done: list[str] = []
    with pytest.MonkeyPatch.context() as patch:

        def before(owner: object, name: str, which: str, after: str = "") -> None:
            real = getattr(owner, name)

            def call(*arguments: object, **names: object) -> object:
                come(which)
                result = real(*arguments, **names)
                if after:
                    come(after)
                return result

            patch.setattr(owner, name, call)

        def come(which: str) -> None:
            is_first = which == step and which not in done
            done.append(which)
            if is_first:
                patch.undo()  # what is done now is no reader's step
                act()

        before(stock_module, "segments", "list")
        before(Segment, "look", "open", "opened")
        before(Segment, "snapshot", "moment")
        before(Segment, "is_begun", "begun")
        before(Segment, "notes", "notes")
        before(Segment, "index", "index")
        before(run_tables, "read_manifest", "manifest")
        before(run_tables, "part_paths", "parts")
        yield done
