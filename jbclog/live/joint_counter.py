"""Counts the joints of each port so far, in a process of its own: ``python -m
jbclog.live.joint_counter RUN``.

Each count finds joints as the report does, in all marked rows, read anew and without a lock. Then
the process rests, so that it takes at most `SHARE` of a core. A joint counts once it ended
`ENDED_S` before its port's last row.

Each count is written as a line (`joint_numbers.Counted`). A line on stdin requests a count now:
`NOW`, or `LAST` once all rows are on the disk. The process ends after `LAST`, when the run is
finalized and counted, or when stdin is closed.
"""

from __future__ import annotations

import os
import select
import sys
import time
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.joints.evidence import NOTHING_RECORDED, PortFound, ports_found
from jbclog.analysis.joints.port_rows import COLUMNS
from jbclog.analysis.verdict.evidence import not_read
from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.core.operating_system import lower_priority
from jbclog.core.rows import PortKey
from jbclog.core.text import json_line
from jbclog.live.joint_numbers import LAST, Counted, PortCount
from jbclog.live.states import OF_TIPS_ONLY
from jbclog.record.clock_steps import COLUMNS as COLUMNS_OF_STEPS
from jbclog.record.clock_steps import KIND as STEP
from jbclog.record.conclude import known_stations
from jbclog.record.journal_reader import Journal
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import SealedFile, read_manifest
from jbclog.record.parts import SORTED, groups_of
from jbclog.record.samples_by_port import SamplesByPort, samples_by_port
from jbclog.record.segments import segments

SHARE: Final = 0.03
LEAST_PAUSE_S: Final = 5.0
LOOK_S: Final = 1.0
ENDED_S: Final = 1.5
NICENESS: Final = 19
STDIN: Final = 0


def main(arguments: list[str]) -> int:
    """Run the process. `arguments`: the run's folder."""
    lower_priority(NICENESS)
    pa.set_cpu_count(1)  # the recorder needs the cores
    pa.set_io_thread_count(1)
    warnings.simplefilter("ignore")  # about damage: missing data is not counted
    try:
        _count_until_final(Path(arguments[0]))
    except RecordError as error:
        _write(Counted(trouble=str(error)))
    except Exception as error:
        _write(Counted(trouble=unexpected_error_text(error)))
    return 0


def _count_until_final(folder: Path) -> None:
    requests = _Requests()
    while not ((folder / MANIFEST).exists() or requests.words) and folder.is_dir():
        if requests.are_over:
            return
        requests.wait(LOOK_S)  # for the run to begin
    counted_journal: list[tuple[str, int]] | None = None
    pause_s = 0.0
    while not requests.are_over:
        journal = _journal(folder)
        if requests.words or journal != counted_journal:
            began_s = time.process_time()
            counted = count(folder, is_last=LAST in requests.words)
            pause_s = max((time.process_time() - began_s) / SHARE, LEAST_PAUSE_S)
            counted_journal = journal
            _write(counted)
            if counted.is_final:
                return
        requests.wait(pause_s)


def _journal(folder: Path) -> list[tuple[str, int]]:
    """Return what changes while a run is recorded: names and sizes of the journal's files."""
    try:
        return [(path.name, path.stat().st_size) for path in segments(folder)]
    except OSError:
        return []


class _Requests:
    """Requests on stdin: `words` since the last look. `are_over`: stdin is closed."""

    def __init__(self) -> None:
        self.words = b""
        self.are_over = False

    def wait(self, most_s: float) -> None:
        """Wait until a request arrives, at most `most_s`."""
        self.words = b""
        if select.select([STDIN], [], [], most_s)[0]:
            self.words = os.read(STDIN, 1 << 16)
            self.are_over = not self.words


def count(folder: Path, *, is_last: bool = False) -> Counted:
    """Count the joints of all ports in the marked rows, as the report does. `is_last`: all rows are
    on the disk. Raises `RecordError`.
    """
    began_s = time.monotonic()

    def read(table: str, columns: list[str]) -> Iterable[pa.Table]:
        return rows_of(folder, table, columns, is_last=is_last)

    manifest = read_manifest(folder)
    is_final = is_last or manifest.is_sealed
    stations = manifest.stations
    if not manifest.is_sealed:
        with Journal(folder) as journal:
            stations = known_stations(journal, manifest.stations)
    samples = samples_of(folder, is_last=is_last)
    ports = ports_found(folder, read, samples, stations, manifest.t0_utc)
    counts = [
        _port_count((facts.name, port), ports.get((facts.name, port)), is_final=is_final)
        for facts in stations
        for port in facts.ports
    ]
    newest_s = max((port.last_s for port in ports.values() if port.rows), default=None)
    age_s = 0.0
    if newest_s is not None and manifest.t0_utc is not None:
        stepped_s = _stepped_s(read("events", COLUMNS_OF_STEPS))
        age_s = max(time.time() - manifest.t0_utc - stepped_s - newest_s, 0.0)
    return Counted(age_s, tuple(counts), is_final, time.monotonic() - began_s)


def rows_of(
    folder: Path, table: str, columns: list[str], *, is_last: bool = False
) -> Iterator[pa.Table]:
    """Yield these columns of a table, of a run that may be in progress: the rows of sealed parts,
    then those of the journal that are marked, or all. Raises `RecordError`.
    """
    with Journal(folder, only_marked=not is_last) as journal:
        seals, newest = _parts_and_newest(journal, table)
        yield from groups_of(seals, columns, seals=seals)
        for rows in newest:
            yield rows.select(columns)


def samples_of(folder: Path, *, is_last: bool = False) -> SamplesByPort:
    """Return the samples of a run that may be in progress, port by port: the rows that `rows_of`
    yields. Raises `RecordError`.
    """
    with Journal(folder, only_marked=not is_last) as journal:
        seals, newest = _parts_and_newest(journal, SORTED)
        return samples_by_port(folder, COLUMNS, newest, parts=seals, seals=seals)


def _parts_and_newest(
    journal: Journal, table: str
) -> tuple[dict[Path, SealedFile], Iterator[pa.Table]]:
    """Return the parts of a table and the rows that are in no part; a sealed run has none."""
    manifest = read_manifest(journal.folder)
    if manifest.is_sealed:
        files = [file for file in manifest.files if file.path.startswith(f"{table}/")]
        newest: Iterator[pa.Table] = iter(())
    else:
        files = [part.file for part in journal.chain.of(table)]
        newest = journal.rows(table)
    return {journal.folder / file.path: file for file in files}, newest


def _stepped_s(events: Iterable[pa.Table]) -> float:
    """Return by how much the wall clock was stepped in all."""
    steps = (group.filter(pc.equal(group["kind"], STEP)) for group in events)
    return sum((pc.sum(some["value"]).as_py() or 0.0 for some in steps), start=0.0)


def _port_count(key: PortKey, port: PortFound | None, *, is_final: bool) -> PortCount:
    if port is None:
        return PortCount(*key, None, 0, OF_TIPS_ONLY)
    last_s = port.last_s - ENDED_S
    found = sum(is_final or joint.end_s <= last_s for joint in port.found.joints)
    why = port.found.why
    if why is None and port.found.unseen:
        why = not_read(port.found.unseen_s)
    if not port.rows:
        why = NOTHING_RECORDED
    return PortCount(*key, found if why is None else None, found, why)


def _write(counted: Counted) -> None:
    sys.stdout.write(json_line(asdict(counted)) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
