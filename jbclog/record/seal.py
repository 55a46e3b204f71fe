"""Sealing: rows move from the live store into Parquet parts, and at the end the run is closed for good.

The order in which things happen is the whole point. A part is complete, synced and compared before it gets its name
(`parts`); what it holds is told by the number of its last batch; only then are batches deleted, and the live store as a
whole only after the manifest says that the run is sealed. Wherever a crash falls, each row is in a part, in the store,
or in both, and who finds it in both knows it.

Hourly, and at the end, the rows are moved by a child process of low priority: ``python -m jbclog.record.seal RUN``.
"""

from __future__ import annotations

import argparse
import os
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.core.errors import RecordError
from jbclog.core.locks import FolderLock
from jbclog.record import parts
from jbclog.record.parts import regroup, remove_leavings, through, write_part
from jbclog.record.schema import TABLES
from jbclog.record.store import Segment, segments
from jbclog.record.store_reader import StoreReader

NICENESS: Final = 10


def seal_rows(folder: Path, *, part: bool = False) -> int:
    """Move what is in the live store into Parquet; give the number of the last batch that is sealed now.

    With `part` the recorder goes on and what was sealed is deleted from its store; without, the store stays until
    `conclude` removes it. The caller holds the folder's lock, or its parent does. Raises `RecordError`.
    """
    try:
        remove_leavings(folder)
        last, sound = _seal_stock(folder)
        if part and sound:  # a damaged store is kept as it is
            _delete(folder, last)
    except (OSError, sqlite3.Error) as error:
        raise RecordError(f"{folder} cannot be sealed: {getattr(error, 'strerror', None) or error}") from error
    return last


def _seal_stock(folder: Path) -> tuple[int, bool]:
    """Seal what is there; give the number of the last batch and whether all of them were sound."""
    with StoreReader(folder) as stock:
        for table in TABLES:
            numbers = stock.numbers_of(table, through(folder, table))
            if numbers:
                write_part(folder, table, partial(_groups, stock, numbers), stock.last)
        parts.note_damage(folder, stock.damage)
        return stock.last, not stock.damage


def _groups(stock: StoreReader, numbers: list[int]) -> Iterator[pa.Table]:
    return regroup(stock.tables(numbers))


def _delete(folder: Path, last: int) -> None:
    for path in segments(folder):
        segment = Segment.open(path)
        try:
            segment.delete_through(last)
        finally:
            segment.close()


class SealChild:
    """`seal_rows` in a child process of low priority. It holds the folder's lock even when the recorder is gone."""

    def __init__(self, folder: Path, lock: FolderLock, *, part: bool = False) -> None:
        command = [sys.executable, "-P", "-m", "jbclog.record.seal", str(folder), "--lock", str(lock.descriptor)]
        self._child = subprocess.Popen(
            command + (["--part"] if part else []),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            pass_fds=[lock.descriptor],
            start_new_session=True,  # Ctrl-C ends the run in good order; it must not end its sealing
        )

    @property
    def pid(self) -> int:
        return self._child.pid

    def ended(self) -> str | None:
        """None while it works; then what went wrong, nothing where all is well."""
        return None if self._child.poll() is None else self.wait()

    def wait(self) -> str:
        """Wait for its end; give what went wrong, nothing where all is well."""
        _, told = self._child.communicate()
        if self._child.returncode == 0:
            return ""
        return told.decode(errors="replace").strip() or f"the sealing child ended with {self._child.returncode}"


def seal_in_child(folder: Path, lock: FolderLock) -> None:
    """Move all rows into Parquet in a child process and wait for it. Raises `RecordError`."""
    problem = SealChild(folder, lock).wait()
    if problem:
        raise RecordError(problem)


def main(arguments: list[str] | None = None) -> int:
    """The child."""
    parser = argparse.ArgumentParser(prog="python -m jbclog.record.seal", description="Seals a run's rows into Parquet.")
    parser.add_argument("run", type=Path)
    parser.add_argument("--part", action="store_true", help="the recorder goes on; delete what was sealed from its store")
    parser.add_argument("--lock", type=int, help="the folder's lock, inherited from the recorder")
    given = parser.parse_args(arguments)
    os.nice(NICENESS)
    pa.set_cpu_count(1)  # beside a recorder that needs its cores
    pa.set_memory_pool(pa.system_memory_pool())  # which gives back what is freed
    try:
        lock = FolderLock(given.run, given.lock) if given.lock is not None else FolderLock.take(given.run)
        lock.expect_ours()
        seal_rows(given.run, part=given.part)
        lock.release()
    except RecordError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
