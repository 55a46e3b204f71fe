"""Sealing that stops before a chosen step, and reading in the middle of which a run is sealed.

A step of sealing is whatever others can see: a part that gets its name, a line of the chain of
parts, the manifest, a removal. A step of reading is whatever it asks of the disk: whether the
recorder is at work, the list of segments, opening one, the chain of parts, the manifest, a part.
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
from jbclog.record import journal_reader
from jbclog.record.conclude import conclude
from jbclog.record.manifest import read_manifest
from jbclog.record.part_chain import PartChain
from jbclog.record.seal import seal_journal

READING = {
    "held": (run_tables, "is_held"),
    "list": (journal_reader, "segments"),
    "open": (journal_reader, "open_regular"),
    "chain": (journal_reader, "PartChain"),
    "segment": (journal_reader, "Segment"),
    "manifest": (run_tables, "read_manifest"),
    "parts": (run_tables, "groups_of"),
}
"""Steps of a reader, and what it calls then."""


class Cut(BaseException):
    """The sealing stops here, as by a kill."""


@dataclass
class Sealing:
    """Seals the run in `folder` until just before its step `until`; None: to the end. `is_open`: as
    once an hour, while its recorder continues. `told`: the steps that were done.
    """

    folder: Path
    until: int | None = None
    is_open: bool = False
    told: list[str] = field(default_factory=list)

    def __call__(self) -> None:
        lock = FolderLock.take(self.folder)
        try:
            with pytest.MonkeyPatch.context() as patch:
                for name in ("replace", "unlink"):
                    patch.setattr(os, name, self._counted(getattr(os, name)))
                patch.setattr(PartChain, "add", self._adding(PartChain.add))
                seal_journal(self.folder, is_open=self.is_open)
                if not self.is_open:
                    conclude(self.folder, read_manifest(self.folder), lock)
        except Cut:
            pass
        finally:
            lock.release()

    def _counted(self, real: Callable[..., None]) -> Callable[..., None]:
        def step(path: Path, *more: object, **names: object) -> None:
            if Path(path).exists():  # to remove what is not there is no step
                self._step(f"{real.__name__} {Path(path).name}")
            real(path, *more, **names)

        return step

    def _adding(self, real: Callable[..., None]) -> Callable[..., None]:
        def step(chain: PartChain, *part: object) -> None:
            self._step("add to the chain")
            real(chain, *part)

        return step

    def _step(self, text: str) -> None:
        if len(self.told) == self.until:
            raise Cut
        self.told.append(text)


@contextmanager
def meanwhile(step: str, act: Callable[[], None], time: int = 1) -> Iterator[None]:
    """Whoever reads inside does `act` just before its step `step`, when it comes to it for the
    `time`-th time; fails if it never does.
    """
    owner, name = READING[step]
    real = getattr(owner, name)
    come = 0

    def call(*arguments: object, **names: object) -> object:
        nonlocal come
        come += 1
        if come == time:
            act()
        return real(*arguments, **names)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(owner, name, call)
        yield
    assert come >= time, step
