"""`jbclog run`, killed with SIGKILL, and what it had kept by then: read from a copy, without the
code that keeps it.

Nothing of this is in the product. A program that kills itself at a chosen step is made by
``python tests/support faults.killed_run STEP NOTES run ...``, or ``... recover ...``: a step is
whatever reaches the disk, as in `crash.Steps`. It tells the moment of its death in NOTES.
"""

from __future__ import annotations

import shutil
import signal
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from support.faults.crash import Steps
from support.faults.guarded import TOLD_S
from support.virtual.served_line import ServedLine

TABLES = ("samples", "events", "settings", "counters")
Rows = dict[str, list[tuple[object, ...]]]
"""By table, in the order of `seq`."""


@dataclass(frozen=True)
class Death:
    """A run that was killed, as it can be seen from outside: `folder` is None where it had not come
    to making one.
    """

    folder: Path | None
    began: float
    died: float
    code: int
    said: str

    @property
    def was_killed(self) -> bool:
        """Or else it had ended before."""
        return self.code == -signal.SIGKILL


def killed(command: list[str], out: Path, is_time: Callable[[float], bool]) -> Death:
    """Run `command`, which records below `out`; kill it as soon as `is_time`, which is given the
    seconds since its start.
    """
    before, began = folders(out), time.monotonic()
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        while run.poll() is None and not is_time(time.monotonic() - began):
            time.sleep(0.001)
        died = time.monotonic()
    finally:
        run.kill()
        _, said = run.communicate(timeout=200)  # which its guard ends
    new = folders(out) - before
    assert len(new) <= 1
    return Death(next(iter(new), None), began, died, run.returncode, said)


def folders(out: Path) -> set[Path]:
    return {path for path in out.iterdir() if path.is_dir()} if out.is_dir() else set()


# -- what it had kept ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Keepsake:
    """What the folder of a killed run held: rows of whole commits, and the number of the last
    commit that was marked.
    """

    rows: Rows
    acknowledged: int
    missing: list[int]


def keepsake(folder: Path, aside: Path) -> Keepsake:
    """Of a copy of `folder` that is made below `aside`."""
    copy = Path(
        shutil.copytree(folder, aside / folder.name, ignore=shutil.ignore_patterns("guard.lock"))
    )
    rows = {table: {row[0]: row for row in _rows_of_parts(copy, table)} for table in TABLES}
    commits: set[int] = set()
    acknowledged = 0
    for path in sorted(copy.glob("live-*.journal")):
        schemas: dict[int, pa.Schema] = {}
        for number, frames in _commits(path.read_bytes()):
            acknowledged = max(acknowledged, 0 if frames else number)
            commits |= {number} if frames else set()
            for frame in frames:
                if frame.kind == SCHEMA:
                    schemas[frame.table] = pa.ipc.read_schema(pa.py_buffer(frame.payload))
                elif frame.kind == ROWS:
                    schema = schemas[frame.table]
                    table = schema.metadata[b"table"].decode()
                    for row in tuples(_table_of(frame, schema)):
                        rows[table].setdefault(row[0], row)
    shutil.rmtree(copy)
    first = min(commits, default=acknowledged + 1)
    missing = [number for number in range(first, acknowledged + 1) if number not in commits]
    return Keepsake(
        {table: [rows[table][seq] for seq in sorted(rows[table])] for table in TABLES},
        acknowledged,
        missing,
    )


FRAME = struct.Struct("<4sBBHHQQIIII")
MARK = struct.Struct("<4sQQI")
SCHEMA, ROWS = 1, 2


@dataclass(frozen=True)
class _Frame:
    kind: int
    table: int
    first: int
    payload: bytes


def _commits(data: bytes) -> Iterator[tuple[int, list[_Frame]]]:
    """The whole commits of a segment, and its marks: without frames. A kill damages nothing but the
    end.
    """
    start = 0
    frames: list[_Frame] = []
    while len(data) - start >= MARK.size:
        if data[start : start + 4] == b"JBCm":
            yield MARK.unpack_from(data, start)[1], []
            start += MARK.size
            continue
        if len(data) - start < FRAME.size:
            return
        _, kind, table, place, count, commit, first, _, length, unpacked, crc = FRAME.unpack_from(
            data, start
        )
        packed = data[start + FRAME.size : start + FRAME.size + length]
        if zlib.crc32(packed, zlib.crc32(data[start : start + FRAME.size - 4])) != crc:
            return
        payload = pa.Codec("zstd").decompress(packed, decompressed_size=unpacked, asbytes=True)
        frames = [*(frames if place else []), _Frame(kind, table, first, payload)]
        if len(frames) == count:
            yield commit, frames
        start += FRAME.size + length


def _table_of(frame: _Frame, schema: pa.Schema) -> pa.Table:
    batch = pa.ipc.read_record_batch(pa.py_buffer(frame.payload), schema)
    rows = pa.Table.from_batches([batch])
    if "seq" not in rows.column_names:
        numbers = range(frame.first, frame.first + len(rows))
        rows = rows.add_column(0, "seq", pa.array(numbers, pa.int64()))
    return rows


def tuples(table: pa.Table) -> Iterator[tuple[object, ...]]:
    """The rows of a table without `run`, times as whole microseconds."""
    columns = [
        column.cast("int64") if pa.types.is_timestamp(column.type) else column
        for name, column in zip(table.column_names, table.columns, strict=True)
        if name != "run"
    ]
    return zip(*(column.to_pylist() for column in columns), strict=True)


def sealed_rows(folder: Path) -> Rows:
    return {table: sorted(_rows_of_parts(folder, table), key=_seq) for table in TABLES}


def _rows_of_parts(folder: Path, table: str) -> Iterator[tuple[object, ...]]:
    for path in sorted((folder / table).glob("part-*.parquet")):
        yield from tuples(pq.read_table(path))


def _seq(row: tuple[object, ...]) -> int:
    assert isinstance(row[0], int)
    return row[0]


def differences(kept: Keepsake, sealed: Rows) -> list[str]:
    """What of the record is not what was kept when it was killed; a guard's diary comes behind the
    events.
    """
    found = [f"I3: commits {kept.missing} were acknowledged and are gone"] if kept.missing else []
    for table in TABLES:
        before, after = kept.rows[table], sealed[table]
        more = len(after) - len(before)
        if after[: len(before)] != before or (more and table != "events"):
            found.append(
                f"I3: {table}: {len(before)} rows were kept, {len(after)} are sealed, and they are"
                " not the same"
            )
    return found


def told_and_not_kept(said: str, sealed: Rows) -> list[str]:
    """The events that people saw and the record does not have. A line is ``12:00:00Z  error
    dde-1: text``.
    """
    texts = {str(row[EVENT_TEXT]) for row in sealed["events"]}
    found = []
    for line in said.splitlines():
        clock, _, rest = line.partition("Z  ")
        if clock.count(":") == 2 and len(clock) == 8:
            text = rest[10:].partition(": ")[2].strip()
            if not any(known.endswith(text) for known in texts):
                found.append(f"shown and not recorded: {line}")
    return found


EVENT_TEXT = 8  # the column of the table


def told_late(line: ServedLine, death: Death) -> list[str]:
    """Tools that the killed run had written to and that were not told to stand within `TOLD_S`."""
    orders = [order for order in line.orders(death.began) if order.port]
    touched = {
        (order.station, order.port)
        for order in orders
        if order.at <= death.died and not order.is_safe
    }
    told = {(order.station, order.port): order.at for order in orders if order.is_stand}
    return [
        f"unsafe: {place} was not told to stand in time"
        for place in touched
        if told.get(place, 1e99) > death.died + TOLD_S
    ]


# -- a program that kills itself -------------------------------------------------------------------


class ToldSteps(Steps):
    """Tells the moment of death before it comes, and how many steps there were if it does not."""

    def step(self) -> None:
        if self.done + 1 == self.fatal:
            self.notes.write_text(f"{time.monotonic()}")
        super().step()

    def note(self, *words: object) -> None:
        return


def main() -> None:
    steps = ToldSteps(int(sys.argv.pop(1)), Path(sys.argv.pop(1)))
    steps.arm()
    from support.product import command_main as jbclog

    jbclog()


if __name__ == "__main__":
    main()
