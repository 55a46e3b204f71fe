"""Record the serial capture of a run: what its sessions received and sent, as rows of the table
`wire`.

The rows are in segments of frames like the journal's (docs/reference/run-folder.md),
``wire-0000.journal`` and so on; `wire` seals and reads them.

1. A row costs the session an append. A thread writes the rows of all stations every `COMMIT_S`.
2. The record takes precedence. A failing disk, little free space or rows that wait for too long
   end the capture, never the run. Nothing is synced before a segment's end.
3. The first rows of each station are the options of its session (`Head`), `what` is ``run``.
"""

from __future__ import annotations

import json
import os
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from jbclog.core.capture_rows import CaptureRow, LinkRow
from jbclog.core.disk_space import write_failure
from jbclog.core.operating_system import PLAIN
from jbclog.record.frames import commit_bytes
from jbclog.record.row_batches import BARE, ROWS_A_FRAME, NotRows, encode, schema_frame
from jbclog.record.schema import CAPTURE

RUN: Final = "run"
COMMIT_S: Final = 0.6
MOST_ROWS: Final = 20_000  # waiting for a station: 90 s of a busy link at 19200 baud
# after each station: a thread that is always runnable would delay each read of the sessions
BREATH_S: Final = 0.001
LEAST_FREE: Final = 64 << 20  # free bytes of the disk reserved for the record
ROWS_A_SEGMENT: Final = 1_000_000

Keep = Callable[[CaptureRow], object]


@dataclass(frozen=True, slots=True)
class Head:
    """The options of a session beyond line file and recipe. Times as in the manifest."""

    station: str
    url: str
    recipe: str  # the file's name in the run's folder `recipes`
    t0_mono: float
    t0_utc: float
    duration_s: float | None = None
    rate: float | str | None = None
    allow_omega_write: bool = False
    allow_missing: bool = False
    jbclog: str = ""


def values_of(row: CaptureRow, head: Head) -> tuple[object, ...]:
    """Return a row of the station of `head`, in the order of the table without `run` and `seq`."""
    text = row.text.encode(errors="replace").decode() or None
    begin = (_micros(row.at_s, head), row.at_s, head.station, row.what)
    if isinstance(row, LinkRow):
        return *begin, row.data or None, text, None, None, None, None
    return *begin, None, text, row.request, row.size, row.sent_s, row.late_s


def values_of_head(head: Head) -> tuple[object, ...]:
    """Return the row that has the options of a session."""
    text = json.dumps(asdict(head))
    begin = (_micros(head.t0_mono, head), head.t0_mono, head.station, RUN)
    return *begin, None, text, None, None, None, None


def _micros(at_s: float, head: Head) -> int:
    return round((at_s - head.t0_mono + head.t0_utc) * 1e6)


class WireRecorder:
    """Writes the capture of a run. Call `begin` for each station, then `start`.

    Any thread may call what `begin` returns, only the recorder's the methods. `trouble`: why the
    capture has ended before the run, or None.
    """

    def __init__(self, folder: Path) -> None:
        self.trouble: str | None = None
        self._folder = folder
        self._heads: list[Head] = []
        self._waiting: list[deque[CaptureRow]] = []
        self._begun = 0  # stations whose options are written
        self._segments = 0
        self._seq = 0
        self._rows_of_segment = 0
        self._bytes_of_segment = 0
        self._commits = 0
        self._descriptor = -1
        self._is_reported = False
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._write_on, name="jbclog-wire", daemon=True)

    def begin(self, head: Head) -> Keep:
        """Begin the capture of a station; return the function that takes its rows."""
        rows: deque[CaptureRow] = deque(maxlen=MOST_ROWS)
        self._waiting.append(rows)
        self._heads.append(head)
        return rows.append

    def start(self) -> None:
        self._thread.start()

    def write(self, breath_s: float = 0.0) -> None:
        """Write the rows so far. Sets `trouble` instead of raising."""
        if self.trouble is not None:
            return
        try:
            self._expect_space()
            values = self._take(breath_s)
            if values:
                self._commit(values)
        except OSError as error:
            self._give_up(write_failure(error, self._folder))
        except NotRows as error:
            self._give_up(f"internal error, {error}")

    def close(self) -> None:
        """Write the rest and sync it. Does not raise."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()
        self.write()
        self._end_segment()

    def news(self) -> str | None:
        """Return the trouble, once."""
        if self._is_reported:
            return None
        self._is_reported = self.trouble is not None
        return self.trouble

    def _expect_space(self) -> None:
        free = shutil.disk_usage(self._folder).free
        if free < LEAST_FREE:
            raise OSError(
                f"less than {LEAST_FREE >> 20} MB are free on the disk, and the record needs them"
            )

    def _take(self, breath_s: float) -> list[object]:
        """Return the values of the rows that wait, end to end."""
        values: list[object] = []
        for head in self._heads[self._begun :]:
            values += values_of_head(head)
        self._begun = len(self._heads)
        for head, rows in zip(self._heads, self._waiting, strict=True):
            count = len(rows)
            if count == MOST_ROWS:
                raise OSError(
                    f"the disk was too slow for it: more than {MOST_ROWS} rows of"
                    f" {head.station} were waiting"
                )
            for _ in range(count):
                values += values_of(rows.popleft(), head)
            if count:
                time.sleep(breath_s)
        return values

    def _commit(self, values: list[object]) -> None:
        frames = []
        if self._descriptor < 0:
            self._begin_segment()
            frames.append(schema_frame(CAPTURE, 0))
        width = len(BARE[CAPTURE])
        first = self._seq
        for start in range(0, len(values), ROWS_A_FRAME * width):
            some = values[start : start + ROWS_A_FRAME * width]
            frames.append(encode(CAPTURE, some, first))
            first += len(some) // width
        data = commit_bytes(self._commits, frames)
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(self._descriptor, rest) :]
        self._bytes_of_segment += len(data)
        self._rows_of_segment += first - self._seq
        self._commits += 1
        self._seq = first
        if self._rows_of_segment >= ROWS_A_SEGMENT:
            self._end_segment()

    def _begin_segment(self) -> None:
        path = self._folder / f"{CAPTURE}-{self._segments:04d}.journal"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | PLAIN
        self._descriptor = os.open(path, flags, 0o644)
        self._segments += 1
        self._bytes_of_segment = 0
        self._rows_of_segment = 0

    def _end_segment(self) -> None:
        if self._descriptor < 0:
            return
        descriptor = self._descriptor
        self._descriptor = -1
        try:
            os.ftruncate(descriptor, self._bytes_of_segment)  # a commit that failed
            os.fsync(descriptor)
        except OSError as error:
            self._give_up(write_failure(error, self._folder))
        finally:
            os.close(descriptor)

    def _give_up(self, why: str) -> None:
        self.trouble = (
            f"The serial capture cannot be written any further: {why}. The run continues without"
            " it."
        )
        self._end_segment()

    def _write_on(self) -> None:
        while not self._ending.wait(COMMIT_S):
            self.write(BREATH_S)
