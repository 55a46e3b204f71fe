"""Write the serial captures of a run; the record itself takes precedence.

1. A row costs the session an append. A thread formats, packs and writes the rows twice a second.
2. A kill loses about half a second of rows.
3. A failing file ends that capture, not the run. So does little free space, which is reserved for
   the record.
4. Memory is bounded: a disk that accepts nothing for more than a minute counts as failing, too.
"""

from __future__ import annotations

import os
import shutil
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from jbclog.core.capture_rows import CaptureRow
from jbclog.core.disk_space import write_failure
from jbclog.core.operating_system import PLAIN, sync_folder
from jbclog.record.capture import COLUMNS, FOLDER, Head, head_line, wire_path
from jbclog.record.capture_file import has_head, line_of, packed

WRITE_S: Final = 0.5
MOST_ROWS: Final = 20_000  # waiting for a station: 90 s of a busy link at 19200 baud
# after each capture: a thread that is always runnable would delay each read of the sessions
BREATH_S: Final = 0.001
LEAST_FREE: Final = 64 << 20  # free bytes of the disk reserved for the record

Keep = Callable[[CaptureRow], object]


class Wire:
    """The capture of one station. Any thread may call `keep`, only the recorder the other
    methods.
    """

    def __init__(self, path: Path, head: Head) -> None:
        self.trouble: str | None = None
        self._rows: deque[CaptureRow] = deque(maxlen=MOST_ROWS)
        self.keep: Keep = self._rows.append
        self._path = path
        self._head = head_line(head)
        self._kin = zlib.crc32(self._head.encode())
        self._blocks = self._lines = self._written = 0
        self._descriptor = -1
        try:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | PLAIN, 0o644)
            self._put("")
        except OSError as error:
            self.give_up(write_failure(error, self._path))

    @property
    def is_open(self) -> bool:
        return self._descriptor >= 0

    def write(self) -> int:
        """Write the rows so far; return their number. Sets `trouble` instead of raising."""
        count = len(self._rows) if self.is_open else 0
        if count == MOST_ROWS:
            self.give_up(f"the disk was too slow for it: more than {MOST_ROWS} rows were waiting")
        elif count:
            try:
                self._put("".join([line_of(self._rows.popleft()) for _ in range(count)]))
            except OSError as error:
                self.give_up(write_failure(error, self._path))
        return count

    def close(self) -> None:
        """Write the rest and sync it."""
        self.write()
        if self.is_open:
            self._end()

    def _put(self, text: str) -> None:
        """Write a whole block of these lines. Raises OSError."""
        text = (
            (COLUMNS if self._blocks == 0 else "")
            + (self._head if has_head(self._blocks) else "")
            + text
        )
        block = packed(text, self._blocks, self._lines + 1, self._kin)
        rest = memoryview(block)
        while rest:
            rest = rest[os.write(self._descriptor, rest) :]
        self._written += len(block)
        self._blocks, self._lines = self._blocks + 1, self._lines + text.count("\n")

    def give_up(self, why: str) -> None:
        """Stop writing; complete blocks stay."""
        self.trouble = (
            f"{FOLDER}/{self._path.name} cannot be written any further: {why}. The run continues"
            " without it."
        )
        if self.is_open:
            self._end()

    def _end(self) -> None:
        descriptor, self._descriptor = self._descriptor, -1
        try:
            os.ftruncate(descriptor, self._written)
            os.fsync(descriptor)
        except OSError as error:
            self.trouble = (
                self.trouble
                or f"{FOLDER}/{self._path.name} cannot be closed: {error.strerror or error}"
            )
        finally:
            os.close(descriptor)
            if not self._written:
                with suppress(OSError):
                    self._path.unlink()  # an empty file is no capture


class WireRecorder:
    """The captures of a run. Call `begin` for each, then `start`; `news` returns new troubles."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._wires: list[Wire] = []
        self._reported: list[Wire] = []  # with reported trouble
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._write_on, name="jbclog-wires", daemon=True)

    def begin(self, head: Head) -> Keep:
        """Create a station's capture; return the function that takes its rows. Does not raise."""
        path = wire_path(self._folder, head.station)
        with suppress(OSError):  # opening the file reports it, too
            path.parent.mkdir(exist_ok=True)
            sync_folder(self._folder)
        wire = Wire(path, head)
        self._wires.append(wire)
        return wire.keep

    def start(self) -> None:
        self._thread.start()

    def write(self, breath_s: float = 0.0) -> None:
        """Write the rows so far. Does not raise."""
        self._check_free_space()
        for wire in self._wires:
            if wire.write():
                time.sleep(breath_s)

    def close(self) -> None:
        """Write the rest and close all files. Does not raise."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()
        self._check_free_space()
        for wire in self._wires:
            wire.close()
        with suppress(OSError):  # the record in the same folder reports it
            sync_folder(self._folder)

    def troubles(self) -> list[str]:
        """Return all troubles, a sentence for each capture."""
        return [wire.trouble for wire in self._wires if wire.trouble is not None]

    def news(self) -> list[str]:
        """Return the troubles not returned before."""
        fresh = [
            wire for wire in self._wires if wire.trouble is not None and wire not in self._reported
        ]
        self._reported += fresh
        return [wire.trouble for wire in fresh if wire.trouble is not None]

    def _check_free_space(self) -> None:
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError:
            return  # the record in the same folder reports it
        if free < LEAST_FREE:
            for wire in self._wires:
                if wire.is_open:
                    wire.give_up(
                        f"less than {LEAST_FREE >> 20} MB are free on the disk, and the record"
                        " needs them"
                    )

    def _write_on(self) -> None:
        while not self._ending.wait(WRITE_S):
            self.write(BREATH_S)
