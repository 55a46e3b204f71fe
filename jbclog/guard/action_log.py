"""The guard's action log: JSON lines in the run's folder, which `recover` turns into events; and
its messages on stderr.

The file is made before anything is hot and filled with blank lines, so that a full disk still takes
the lines. Actions after a run is sealed are added to its `annotations.jsonl` instead.
"""

from __future__ import annotations

import json
import os
import select
import time
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any, Final

from jbclog.core.files import Kind
from jbclog.core.json_files import read_json
from jbclog.core.line_file import LineFile
from jbclog.core.text import clean

NAME: Final = "guard.jsonl"
MANIFEST: Final = "manifest.json"
LEAST_BYTES: Final = 65536
LINE_BYTES: Final = 512  # of one line, at most
STDERR = 2


class ActionLog:
    """Appends lines that are on the disk when `write` returns; if the disk fails, the guard
    continues.

    `who` signs annotations of a sealed run. `is_torn`: a line was lost.
    """

    def __init__(self, folder: Path, who: str = "jbclog guard") -> None:
        self.folder = folder
        self._file = LineFile(folder / NAME, Kind.ACTION_LOG)
        self._who = who
        self._lock = Lock()
        self._lines = 0  # reserved, plus one
        self.is_torn = False

    def reserve(self, lines: int = 0) -> None:
        """Reserve space on the disk for so many lines; none in a sealed run. Raises OSError."""
        if lines < self._lines or is_sealed(self.folder):
            return
        self._lines = lines + 1
        with self._lock:
            self._file.reserve(max(LEAST_BYTES, lines * LINE_BYTES))

    def write(
        self,
        kind: str,
        severity: str,
        text: str,
        station: str | None = None,
        port: int | None = None,
        value: float | None = None,
    ) -> None:
        """Append an event (docs/reference/events.md) with the current time. Does not raise."""
        row = {
            "time": time.time_ns() // 1000,
            "kind": kind,
            "severity": severity,
            "text": text,
            "station": station,
            "port": port,
        }
        if value is not None:
            row["value"] = value
        try:
            self._write(row)
        except Exception:  # the disk, or memory refused for a moment
            try:
                self._write(row)
            except Exception:
                self.is_torn = True

    def _write(self, row: dict[str, Any]) -> None:
        with self._lock:
            if is_sealed(self.folder):
                self._annotate(row["kind"], row["text"], row["station"], row["port"])
            else:
                self._file.append_line(json.dumps(row).encode())

    def tidy(self) -> None:
        """Release unused space when the run is over, and remove an empty file. Does not raise."""
        with suppress(OSError), self._lock:
            if not is_sealed(self.folder):
                self._file.release()

    def _annotate(self, kind: str, text: str, station: str | None, port: int | None) -> None:
        from jbclog.record.annotations import append  # only here: a watching guard does not load it

        place = (
            ""
            if station is None
            else f"{station}: "
            if port is None
            else f"{station} port {port}: "
        )
        append(
            self.folder,
            who=self._who,
            what=f"{place}{text}",
            why="its recorder had ended without it",
            kind=kind,
        )


def is_sealed(folder: Path) -> bool:
    """Whether the run's record is sealed and never changes again."""
    try:
        return bool(read_json(folder / MANIFEST, Kind.MANIFEST)["state"] == "sealed")
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return False


def show(text: str) -> None:
    """Write a line to the recorder's stderr if that takes it at once; control characters of
    stations and files are removed.
    """
    with suppress(Exception):  # a message must never delay a rescue
        watched = select.poll()
        watched.register(STDERR, select.POLLOUT)
        if any(event & select.POLLOUT for _, event in watched.poll(0)):
            os.write(
                STDERR,
                f"{clean(f'jbclog guard: {text}')}\n".encode("utf-8", "backslashreplace")[
                    : select.PIPE_BUF
                ],
            )


def close_stream(stream: int) -> None:
    """Point `stream` to the null device: its reader sees the end, later output is discarded."""
    with suppress(OSError):
        null = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
        os.dup2(null, stream)
        os.close(null)
