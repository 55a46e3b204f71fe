"""What the guard did, a JSON line each, in the run's folder: `recover` makes events of them."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from threading import Lock
from typing import Final

NAME: Final = "guard.jsonl"
OPEN_RUNS_HAVE: Final = "live[.-]*"  # files that a sealed run does not have


class Diary:
    """Appends lines that are on the disk when `write` returns. Where the disk takes none, the tools come first.

    A run that has been sealed meanwhile is never changed: then only who reads along hears of it.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = Lock()

    def write(self, kind: str, severity: str, text: str, station: str | None = None, port: int | None = None) -> None:
        """One line: an event of the record (contract, "events"), with the time of now."""
        row = {"time": time.time_ns() // 1000, "kind": kind, "severity": severity, "text": text, "station": station, "port": port}
        try:
            with self._lock:
                if any(self._folder.glob(OPEN_RUNS_HAVE)):
                    self._append(json.dumps(row) + "\n")
        except OSError:
            return

    def _append(self, line: str) -> None:
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        descriptor = os.open(self._folder / NAME, flags, 0o644)
        try:
            os.write(descriptor, line.encode())
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
