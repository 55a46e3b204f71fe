"""A disk in memory for the journal's writer: any operation can fail, and a crash leaves any state
that POSIX allows.

What was written since the last sync may be there, partly there, in another order, or not; a file's
creation or removal counts once its folder is synced. After a sync that failed nothing that was not
synced before can be relied upon, whatever is synced later.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from jbclog.record.segments import Disk

BLOCK = 64
"""Bytes that reach the disk together."""


@dataclass
class ModelFile:
    """A file as processes see it (`data`), and all states since its last sync that went well."""

    data: bytes = b""
    states: list[bytes] = field(default_factory=lambda: [b""])
    is_doubtful: bool = False  # a sync failed

    def change(self, data: bytes) -> None:
        self.data = data
        self.states.append(data)

    def after_crash(self, rng: Random) -> bytes:
        sizes = [len(state) for state in self.states]
        size = rng.choice([*sizes, rng.randint(min(sizes), max(sizes))])
        blocks = []
        for start in range(0, size, BLOCK):
            state = rng.choice(self.states)
            blocks.append(state[start : start + BLOCK].ljust(BLOCK, b"\0"))
        return b"".join(blocks)[:size]


class ModelDisk(Disk):
    """`failures` has, by number of the operation, from 0, its error, or 0 for a write that is cut
    short.
    """

    def __init__(self, failures: Mapping[int, int], rng: Random) -> None:
        self.names: dict[str, ModelFile] = {}
        self.operations = 0
        self.failed = 0
        self._failures = failures
        self._rng = rng
        self._files: list[ModelFile] = []
        self._unsynced: set[str] = set()  # created
        self._removed: dict[str, ModelFile] = {}  # not synced

    def create(self, path: Path) -> int:
        self._operate()
        assert path.name not in self.names
        self._files.append(ModelFile())
        self.names[path.name] = self._files[-1]
        self._unsynced.add(path.name)
        return len(self._files) - 1

    def write(self, file: int, data: memoryview) -> int:
        model = self._files[file]
        part = bytes(data[: self._rng.randint(0, len(data) - 1)])
        try:
            is_short = self._operate()
        except OSError:
            model.change(model.data + part)
            raise
        written = part or bytes(data[:1]) if is_short else bytes(data)
        model.change(model.data + written)
        return len(written)

    def sync(self, file: int) -> None:
        model = self._files[file]
        try:
            self._operate()
        except OSError:
            model.is_doubtful = True
            raise
        if not model.is_doubtful:
            model.states = [model.data]

    def truncate(self, file: int, size: int) -> None:
        self._operate()
        model = self._files[file]
        assert size <= len(model.data)
        model.change(model.data[:size])

    def close(self, file: int) -> None:
        self._operate()

    def remove(self, path: Path) -> None:
        self._operate()
        if path.name in self.names:
            self._removed[path.name] = self.names.pop(path.name)

    def sync_folder(self, folder: Path) -> None:
        self._operate()
        self._unsynced.clear()
        self._removed.clear()

    def is_at(self, file: int, path: Path) -> bool:
        return self.names.get(path.name) is self._files[file]

    def reserve(self, path: Path, size: int) -> None:
        self._operate()

    def release(self, path: Path, size: int) -> bool:
        self._operate()
        return True

    def after_kill(self) -> dict[str, bytes]:
        """Return the files as they are once the recorder is gone, by name."""
        return {name: model.data for name, model in self.names.items()}

    def after_crash(self, rng: Random) -> dict[str, bytes]:
        """Return the files as they may be once the computer runs again, by name."""
        files = {}
        for name, model in (self._removed | self.names).items():
            is_sure = name in self.names and name not in self._unsynced
            if is_sure or rng.random() < 0.5:
                files[name] = model.after_crash(rng)
        return files

    def _operate(self) -> bool:
        """Count an operation, which may fail; return True if it is cut short."""
        error = self._failures.get(self.operations)
        self.operations += 1
        if error is None:
            return False
        self.failed += 1
        if error:
            raise OSError(error, os.strerror(error))
        return True


ERRORS = (errno.EIO, errno.ENOSPC, errno.EFBIG, 0)
