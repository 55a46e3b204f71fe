"""Sealing: a segment of the journal becomes a Parquet part of each table.

1. A part is complete, synced and compared before it gets its name (`part_writer`), which has the
   segment's number. A part counts when it is in the chain (`part_chain`), synced. Then the segment
   is removed.
2. A part has the rows above the greatest `seq` in the parts of earlier segments. So each step can
   be repeated after a crash: a part that is not in the chain is written again, with the same name
   and rows.
3. What damage took from a segment is noted before its rows are in parts. A damaged segment is kept
   in `damaged/`.
4. The last segment that begins with the notes of the run and what is known of the stations stays
   until the manifest is sealed (`conclude`). The recorder writes to no segment before it.

A child process of low priority does this hourly and at the end: ``python -m jbclog.record.seal
RUN``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError
from jbclog.core.locks import FolderLock
from jbclog.core.operating_system import lower_priority, sync_folder
from jbclog.core.rows import TABLES
from jbclog.record.damage import is_noted, keep_copy, note_damage
from jbclog.record.journal_reader import Journal, Segment, losses
from jbclog.record.part_writer import collected, write_part
from jbclog.record.parts import remove_leavings
from jbclog.record.wire import seal_capture

NICENESS: Final = 10


def seal_journal(folder: Path, *, is_open: bool = False) -> None:
    """Make parts of all segments; with `is_open`, the recorder continues in the last one.

    The caller or its parent holds the folder's lock. Raises `RecordError`.
    """
    try:
        remove_leavings(folder)
        with Journal(folder) as journal:
            kept = journal.last_begun()
            for place, segment in enumerate(journal.segments()):
                if place < kept or not is_open:
                    _seal_segment(journal, place, segment)
                if place < kept:
                    segment.path.unlink()
                    sync_folder(folder)
        seal_capture(folder, is_open=is_open)
    except OSError as error:
        raise RecordError(f"{folder} cannot be sealed: {write_failure(error, folder)}") from error


def _seal_segment(journal: Journal, place: int, segment: Segment) -> None:
    folder, chain = journal.folder, journal.chain
    note_damage(folder, losses(journal, place, segment))
    for table in TABLES:
        if chain.has(table, segment.number):
            continue
        above = chain.last_seq(table, before=segment.number)
        rows = collected(table, segment.rows(table, above))
        note_damage(folder, segment.damage)
        if rows.num_rows:
            chain.add(segment.number, write_part(folder, table, rows, segment.number))
    if is_noted(folder, segment.path):
        keep_copy(folder, segment.path)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m jbclog.record.seal", description="Seals a run's rows into Parquet."
    )
    parser.add_argument("run", type=Path)
    parser.add_argument(
        "--part", action="store_true", help="the recorder continues in the last segment"
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
        seal_journal(given.run, is_open=given.part)
        lock.release()
    except RecordError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
