"""What was done about tools that their recorder left, a JSON line each, in the run's folder: `recover` makes events of them.

The file is there before anything is hot: blank lines that take the room of what may have to be written, so that a disk
that is full by then takes it all the same. A run that is sealed meanwhile is never changed; what is said of it goes into
its `annotations.jsonl`.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock
from typing import Any, Final

from jbclog.core.foreign.files import Kind, expect_opened
from jbclog.core.foreign.json_reader import read_json

NAME: Final = "guard.jsonl"
MANIFEST: Final = "manifest.json"
BLANK: Final = b"\n"
LEAST_BYTES: Final = 65536
LINE_BYTES: Final = 512  # that one line may take
FLAGS: Final = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK


class ActionLog:
    """Keeps lines that are on the disk when `write` returns. Where the disk takes none, the tools come first.

    `who` says it, where it is said of a sealed run. `is_torn`: something that was to be kept is not.
    """

    def __init__(self, folder: Path, who: str = "jbclog guard") -> None:
        self._folder = folder
        self._who = who
        self._lock = Lock()
        self._lines = 0  # from which on there is no room yet
        self.is_torn = False

    def reserve(self, lines: int = 0) -> None:
        """Have room for so many lines, in blocks that are really written; none in a sealed run. Raises `OSError`."""
        if lines < self._lines or is_sealed(self._folder):
            return
        self._lines = lines + 1
        with self._lock, self._opened() as descriptor:
            end, size = len(_content(descriptor)), os.fstat(descriptor).st_size
            missing = end + max(LEAST_BYTES, lines * LINE_BYTES) - size
            if missing > 0:
                _put(descriptor, BLANK * missing, size)

    def write(self, kind: str, severity: str, text: str, station: str | None = None, port: int | None = None) -> None:
        """One line: an event of the record (docs/reference/events.md), with the time of now."""
        row = {"time": time.time_ns() // 1000, "kind": kind, "severity": severity, "text": text, "station": station, "port": port}
        try:
            self._write(row)
        except Exception:  # the disk, or for a moment no memory
            try:
                self._write(row)
            except Exception:
                self.is_torn = True

    def _write(self, row: dict[str, Any]) -> None:
        with self._lock:
            if is_sealed(self._folder):
                self._annotate(row["kind"], row["text"], row["station"], row["port"])
            else:
                self._append(json.dumps(row).encode())

    def tidy(self) -> None:
        """Give the room back that was not needed, and the file where nothing was: the run is over. Does not raise."""
        with suppress(OSError), self._lock:
            if not is_sealed(self._folder):
                tidy(self._folder / NAME)

    def _append(self, line: bytes) -> None:
        with self._opened() as descriptor:
            content = _content(descriptor)
            _put(descriptor, (BLANK if content else b"") + line + BLANK, len(content))

    @contextmanager
    def _opened(self) -> Iterator[int]:
        descriptor = os.open(self._folder / NAME, FLAGS, 0o644)
        try:
            expect_opened(descriptor, Kind.ACTION_LOG)
            yield descriptor
        finally:
            os.close(descriptor)

    def _annotate(self, kind: str, text: str, station: str | None, port: int | None) -> None:
        from jbclog.record.annotations import append  # only now: a guard that watches has no use for it

        place = "" if station is None else f"{station}: " if port is None else f"{station} port {port}: "
        append(self._folder, who=self._who, what=f"{place}{text}", why="its recorder had ended without it", kind=kind)


def is_sealed(folder: Path) -> bool:
    """Whether the run's record is finished, and never changes again."""
    try:
        return bool(read_json(folder / MANIFEST, Kind.MANIFEST)["state"] == "sealed")
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return False


def tidy(path: Path) -> None:
    """Cut the blank lines off; without any other there is no file. Raises `OSError`."""
    with suppress(FileNotFoundError):
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
        try:
            content = _content(descriptor)
            if not content:
                path.unlink()
            elif os.fstat(descriptor).st_size > len(content) + 1:
                os.ftruncate(descriptor, len(content) + 1)
                os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _content(descriptor: int) -> bytes:
    """What was written, without the room behind it. A line that was torn off ends here, too: the next begins anew."""
    return os.pread(descriptor, os.fstat(descriptor).st_size, 0).rstrip(BLANK)


def _put(descriptor: int, data: bytes, at: int) -> None:
    while data:
        done = os.pwrite(descriptor, data, at)
        data, at = data[done:], at + done
    os.fsync(descriptor)
