"""Counts the joints of each port so far, for whoever follows a run or wants it to end: ``python -m jbclog.live.joint_counter RUN``.

It finds them as the report does, in what is committed, without a lock. A joint that ended less than `ENDED_S` before its port's
last row is not counted yet. After each count it writes a line (`joint_numbers.Counted`) and rests `REST` times as long as that
took: less than 1.5 % of a core however long the run is. A line on stdin asks for a count now: `NOW`, or `LAST` when all rows are
committed. It ends after that count, when the run is finalized and counted, and when stdin is closed.
"""

from __future__ import annotations

import os
import select
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.analysis.joints.evidence import NOTHING_RECORDED, PortFound, ports_found
from jbclog.analysis.verdict.evidence import not_read
from jbclog.analysis.verdict.rules import has_tip
from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.core.locks import commit_status
from jbclog.core.rows import StationFacts
from jbclog.core.text import json_line
from jbclog.live.joint_numbers import LAST, Counted, PortCount
from jbclog.live.open_rows import OpenRows
from jbclog.live.run_follower import stations_of
from jbclog.live.states import OF_TIPS_ONLY
from jbclog.live.store_follower import Sealed
from jbclog.record.manifest import RunState, read_manifest

ENDED_S: Final = 1.5
LEAST_PAUSE_S: Final = 2.0
REST: Final = 80
TRIES: Final = 5
NICENESS: Final = 19
STDIN: Final = 0


def main(arguments: list[str]) -> int:
    """Run the process. `arguments`: the run's folder."""
    os.nice(NICENESS)
    pa.set_cpu_count(1)  # the recorder needs the cores
    pa.set_io_thread_count(1)
    warnings.simplefilter("ignore")  # of damage: missing data is not counted
    try:
        _count_until_final(Path(arguments[0]))
    except Exception as error:
        _write(Counted(trouble=str(error) if isinstance(error, RecordError) else unexpected_error_text(error)))
    return 0


def _count_until_final(folder: Path) -> None:
    counted, through, asked = Counted(), -1, b""
    while not counted.is_final:
        began, last, pause = time.process_time(), commit_status(folder).last, LEAST_PAUSE_S
        if last != through or asked:
            counted, is_first = count(folder, is_last=LAST in asked), through < 0
            through, asked = last, b""
            _write(counted)
            if not is_first:  # which loads much: a run of a minute would have no other
                pause = max(LEAST_PAUSE_S, REST * (time.process_time() - began))
        if select.select([STDIN], [], [], 0.0 if counted.is_final else pause)[0]:
            asked = os.read(STDIN, 1 << 16)
            if not asked:
                return


def count(folder: Path, *, is_last: bool = False) -> Counted:
    """Count the joints of all ports now. `is_last`: all rows are committed. Raises RecordError."""
    for _ in range(TRIES):
        began, rows = time.monotonic(), OpenRows(folder, commit_status(folder).last or None)
        manifest = read_manifest(folder)
        is_final = is_last or manifest.state == RunState.SEALED
        stations = stations_of(folder, manifest)
        try:
            found = ports_found(folder, rows.groups, stations, manifest.t0_utc)
        except Sealed:
            continue
        ports = tuple(_ports(stations, found, 0.0 if is_final else ENDED_S))
        return Counted(time.monotonic() - began, ports, is_final)
    raise RecordError(f"{folder} was sealed again and again")


def _ports(stations: list[StationFacts], found: dict[tuple[str, int], PortFound], ended_s: float) -> Iterator[PortCount]:
    for facts in stations:
        for port in facts.ports:
            if has_tip(facts):
                yield _port(facts.name, port, found[facts.name, port], ended_s)
            else:
                yield PortCount(facts.name, port, None, 0, OF_TIPS_ONLY)


def _port(station: str, port: int, one: PortFound, ended_s: float) -> PortCount:
    found = sum(joint.end_s <= one.last_s - ended_s or not ended_s for joint in one.found.joints)
    why = NOTHING_RECORDED if not one.rows else one.found.why or (not_read(one.found.unseen_s) if one.found.unseen else None)
    return PortCount(station, port, found if why is None else None, found, why)


def _write(counted: Counted) -> None:
    sys.stdout.write(json_line(asdict(counted)) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
