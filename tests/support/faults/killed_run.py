"""`jbclog run`, killed with SIGKILL, and what it had kept by then: read from a copy, without the
code that keeps it.

Nothing of this is in the product. A program that kills itself at a chosen step is made by
``python tests/support faults.killed_run STEP NOTES run ...``, or ``... recover ...``: a step is
whatever reaches the disk, as in `crash.Steps`. It tells the moment of its death in NOTES.
"""

from __future__ import annotations

import json
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from support.faults.crash import Steps
from support.faults.guarded import TOLD_S
from support.virtual.served_line import ServedLine

TABLES = ("samples", "events", "settings", "counters")
THROUGH = b"jbclog.through"
Rows = dict[str, list[tuple[object, ...]]]
"""By table, in the order of writing."""


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
    """What the folder of a killed run held: rows that were committed, and the number of the last
    batch acknowledged.
    """

    rows: Rows
    acknowledged: int
    missing: list[int]


def keepsake(folder: Path, aside: Path) -> Keepsake:
    """Of a copy of `folder` that is made below `aside`: opening a database changes it."""
    copy = Path(
        shutil.copytree(folder, aside / folder.name, ignore=shutil.ignore_patterns("guard.lock"))
    )
    acknowledged = _acknowledged(copy)
    batches: dict[int, tuple[str, pa.Table]] = {}
    for path in copy.glob("live*.sqlite"):
        batches |= dict(_batches(path))
    rows, sealed = {}, 0
    for table in TABLES:
        parts = sorted((copy / table).glob("part-*.parquet"))
        through = int(pq.read_metadata(parts[-1]).metadata[THROUGH]) if parts else 0
        mine = [
            batches[number][1]
            for number in sorted(batches)
            if batches[number][0] == table and number > through
        ]
        rows[table] = [row for one in [*map(pq.read_table, parts), *mine] for row in tuples(one)]
        sealed = max(sealed, through)
    missing = [number for number in range(sealed + 1, acknowledged + 1) if number not in batches]
    shutil.rmtree(copy)
    return Keepsake(rows, acknowledged, missing)


def _acknowledged(folder: Path) -> int:
    try:
        return int(json.loads((folder / "live.lock").read_text())["last"])
    except (OSError, ValueError):
        return 0


def _batches(path: Path) -> Iterator[tuple[int, tuple[str, pa.Table]]]:
    with closing(sqlite3.connect(path)) as store:
        try:
            found = store.execute("SELECT number, name, data FROM batch ORDER BY number").fetchall()
        except sqlite3.OperationalError:  # no tables yet
            return
    for number, name, data in found:
        stream = pa.Codec("zstd").decompress(
            data[4:], decompressed_size=struct.unpack_from("<I", data)[0]
        )
        yield number, (name, pa.ipc.open_stream(stream).read_all())


def tuples(table: pa.Table) -> Iterator[tuple[object, ...]]:
    """The rows of a table, times as whole microseconds."""
    columns = [
        column.cast("int64") if pa.types.is_timestamp(column.type) else column
        for column in table.columns
    ]
    return zip(*(column.to_pylist() for column in columns), strict=True)


def sealed_rows(folder: Path) -> Rows:
    return {
        table: [
            row
            for path in sorted((folder / table).glob("part-*.parquet"))
            for row in tuples(pq.read_table(path))
        ]
        for table in TABLES
    }


def differences(kept: Keepsake, sealed: Rows) -> list[str]:
    """What of the record is not what was kept when it was killed; a guard's diary comes behind the
    events.
    """
    found = [f"I3: batches {kept.missing} were acknowledged and are gone"] if kept.missing else []
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
    from jbclog.cli import main as jbclog

    jbclog()


if __name__ == "__main__":
    main()
