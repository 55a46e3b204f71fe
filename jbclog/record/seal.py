"""Sealing: move rows from the live store into Parquet parts.

The order survives a crash anywhere. A part is complete, synced and compared before it gets its name
(`parts`) and carries the number of its last batch; then its batches are deleted; the store itself
is removed only after the manifest says "sealed". So each row is in a part, in the store, or
recognizably in both.

A child process of low priority does this hourly and at the end: ``python -m jbclog.record.seal
RUN``.
"""

from __future__ import annotations

import argparse
import sqlite3
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError
from jbclog.core.locks import FolderLock
from jbclog.core.operating_system import lower_priority
from jbclog.core.rows import TABLES
from jbclog.record import parts
from jbclog.record.parts import remove_leavings, through, write_part
from jbclog.record.store import Segment, segments
from jbclog.record.store_reader import StoreReader

NICENESS: Final = 10
ROWS_A_PART: Final = 8_000_000  # an hour of 256 ports at 10 Hz; a footer of 1.3 MB


def seal_rows(folder: Path, *, part: bool = False) -> int:
    """Move the rows of the live store into Parquet; return the number of the last sealed batch.

    With `part` the recorder continues and sealed batches are deleted from its store; without,
    `conclude` removes the store. The caller or its parent holds the folder's lock. Raises
    `RecordError`.
    """
    try:
        remove_leavings(folder)
        last, sound = _seal_store(folder)
        if part and sound:  # a damaged store stays as it is
            _delete(folder, last)
    except (OSError, sqlite3.Error) as error:
        raise RecordError(f"{folder} cannot be sealed: {write_failure(error, folder)}") from error
    return last


def _seal_store(folder: Path) -> tuple[int, bool]:
    """Seal all batches; return the number of the last one, and True if all were sound."""
    with StoreReader(folder) as store:
        for table in TABLES:
            numbers = store.numbers_of(table, through(folder, table))
            for some, last in _shares(store, numbers):
                write_part(folder, table, partial(store.row_groups, some), last)
        parts.note_damage(folder, store.damage)
        return store.last, not store.damage


def _shares(store: StoreReader, numbers: list[int]) -> Iterator[tuple[list[int], int]]:
    """Divide batches among parts, whose footers are read whole; yield the batches of each part and
    the number of its last.
    """
    count = max(ROWS_A_PART // store.mean_rows, 1)
    for at in range(0, len(numbers), count):
        some = numbers[at : at + count]
        yield some, store.last if some[-1] == numbers[-1] else some[-1]


def _delete(folder: Path, last: int) -> None:
    for path in segments(folder):
        segment = Segment.open(path)
        try:
            segment.delete_through(last)
        finally:
            segment.close()


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m jbclog.record.seal", description="Seals a run's rows into Parquet."
    )
    parser.add_argument("run", type=Path)
    parser.add_argument(
        "--part",
        action="store_true",
        help="the recorder continues; delete sealed batches from its store",
    )
    parser.add_argument("--lock", type=int, help="the folder's lock, inherited from the recorder")
    given = parser.parse_args(arguments)
    lower_priority(NICENESS)
    pa.set_cpu_count(1)  # the recorder needs the other cores
    pa.set_memory_pool(pa.system_memory_pool())  # returns freed memory to the system
    try:
        lock = (
            FolderLock(given.run, given.lock)
            if given.lock is not None
            else FolderLock.take(given.run)
        )
        lock.expect_ours()
        seal_rows(given.run, part=given.part)
        lock.release()
    except RecordError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
