"""What the guard did, a JSON line each, in the run's folder: `recover` makes events of them."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from threading import Lock
from typing import Final

NAME: Final = "guard.jsonl"


class Diary:
    """Appends lines that are on the disk when `write` returns. Where the disk takes none, the tools come first."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        self._lock = Lock()

    def write(
        self, kind: str, severity: str, text: str, station: str | None = None, port: int | None = None, raw: str | None = None
    ) -> None:
        """One line: an event of the record (contract, "events"), with the time of now."""
        row = {"time": time.time_ns() // 1000, "kind": kind, "severity": severity, "text": text}
        row |= {"station": station, "port": port, "raw": raw}
        try:
            with self._lock:
                self._append(json.dumps(row) + "\n")
        except OSError:
            return

    def _append(self, line: str) -> None:
        descriptor = os.open(self._path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
        try:
            os.write(descriptor, line.encode())
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
