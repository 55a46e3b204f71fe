"""Counts the joints of each port so far, for whoever follows a run or wants it to end: ``python -m
jbclog.live.joint_counter RUN``.

It finds them as the report does, in what is committed, without a lock. A joint that ended less than
`ENDED_S` before its port's last row is not counted yet. Counts are made of the record as it stood
after certain commits, which depend on the run alone (`scheduled`): two processes that count the
same run show the same numbers of the same age, whenever they were started. Counting takes less than
1.5 % of a core in the long run. Each count is a line (`joint_numbers.Counted`). A line on stdin
asks for a count of everything now: `NOW`, or `LAST` when all rows are committed. The process ends
after that count, when the run is finalized and counted, and when stdin is closed.
"""

from __future__ import annotations

import math
import os
import select
import sys
import time
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.analysis.joints.evidence import NOTHING_RECORDED, PortFound, clock_steps, ports_found
from jbclog.analysis.verdict.evidence import not_read
from jbclog.analysis.verdict.rules import has_tip
from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.core.locks import commit_status
from jbclog.core.rows import StationFacts
from jbclog.core.text import json_line
from jbclog.live.joint_numbers import LAST, Counted, Key, PortCount
from jbclog.live.open_rows import OpenRows
from jbclog.live.run_follower import stations_of
from jbclog.live.states import OF_TIPS_ONLY
from jbclog.live.store_follower import Sealed
from jbclog.record.manifest import RunState, read_manifest

ENDED_S: Final = 1.5
LOOK_S: Final = 1.0
NO_COMMIT_S: Final = 5.0  # after which a run that stands still is counted to its end
REST: Final = 80
BATCHES_PER_S: Final = 1.5  # of a run; most commits, 0.8 s apart, have one
PORT_S, ROWS_S = 0.05, 1e-4  # of computing for a port, and for its rows in a batch
SLOW: Final = 4  # times slower than that, a machine has its own schedule
FEW_BATCHES: Final = 16
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
        _write(
            Counted(
                trouble=(
                    str(error) if isinstance(error, RecordError) else unexpected_error_text(error)
                )
            )
        )
    return 0


def _count_until_final(folder: Path) -> None:
    counted, through, asked, took_s, growth = Counted(), -1, b"", 0.0, _Growth()
    while not counted.is_final:
        last, ports = commit_status(folder).last, len(counted.ports) or _number_of_ports(folder)
        now = last if asked or growth.has_ended(last) else scheduled(last, ports, took_s)
        if now != through or asked:
            began, is_first = time.process_time(), through < 0
            counted = count(folder, now or None, is_last=LAST in asked)
            took_s = 0.0 if is_first else time.process_time() - began  # the first one loads much
            through, asked = now, b""
            if now or counted.is_final:
                _write(counted)
        if select.select([STDIN], [], [], 0.0 if counted.is_final else LOOK_S)[0]:
            asked = os.read(STDIN, 1 << 16)
            if not asked:
                return


def _number_of_ports(folder: Path) -> int:
    return sum(len(facts.ports) for facts in stations_of(folder, read_manifest(folder)))


class _Growth:
    """Whether a run grows: one that has crashed has no further commits."""

    def __init__(self) -> None:
        self._last, self._since = -1, 0.0

    def has_ended(self, last: int) -> bool:
        """Return whether the number of the last batch stays the same for `NO_COMMIT_S`."""
        if last != self._last:
            self._last, self._since = last, time.monotonic()
        return time.monotonic() - self._since >= NO_COMMIT_S


def scheduled(last: int, ports: int, took_s: float = 0.0) -> int:
    """Return the batch through which the next count goes, where `last` is the newest one; the same
    for all who count this run.

    The distance of two counts is a power of two, at most half of the run, and long enough for
    `ports`. `took_s`: the last count; it has a say only on a machine that is much slower than
    others.
    """
    if last < 1:
        return 0
    enough = REST * BATCHES_PER_S * max(ports * (PORT_S + ROWS_S * last), took_s / SLOW)
    most = 1 << (last.bit_length() - (1 if last < FEW_BATCHES else 2))
    step = min(1 << max(math.ceil(enough) - 1, 0).bit_length(), most)
    return last - last % step


def count(folder: Path, through: int | None = None, *, is_last: bool = False) -> Counted:
    """Count the joints of all ports through a batch; None: all that is committed. `is_last`: that
    is all.

    Raises RecordError.
    """
    for _ in range(TRIES):
        began, rows = (
            time.monotonic(),
            OpenRows(folder, through or commit_status(folder).last or None),
        )
        manifest = read_manifest(folder)
        is_final = is_last or manifest.state == RunState.SEALED
        if is_final:
            rows = OpenRows(folder, None)
        stations = stations_of(folder, manifest)
        try:
            found = ports_found(folder, rows.groups, stations, manifest.t0_utc)
            age_s = _age_s(rows, found, manifest.t0_utc)
        except Sealed:
            continue
        ports = tuple(_ports(stations, found, 0.0 if is_final else ENDED_S))
        return Counted(age_s, ports, is_final, time.monotonic() - began)
    raise RecordError(f"{folder} was sealed again and again")


def _age_s(rows: OpenRows, found: Mapping[Key, PortFound], t0_utc: float | None) -> float:
    """Return the age of the newest row that was counted, by the run's clock: without the steps of
    the wall clock.
    """
    newest_s = max((one.last_s for one in found.values() if one.rows), default=None)
    if newest_s is None or t0_utc is None:
        return 0.0
    return max(
        time.time() - t0_utc - sum(step.size_s for step in clock_steps(rows.groups)) - newest_s, 0.0
    )


def _ports(
    stations: list[StationFacts], found: dict[tuple[str, int], PortFound], ended_s: float
) -> Iterator[PortCount]:
    for facts in stations:
        for port in facts.ports:
            if has_tip(facts):
                yield _port(facts.name, port, found[facts.name, port], ended_s)
            else:
                yield PortCount(facts.name, port, None, 0, OF_TIPS_ONLY)


def _port(station: str, port: int, one: PortFound, ended_s: float) -> PortCount:
    found = sum(joint.end_s <= one.last_s - ended_s or not ended_s for joint in one.found.joints)
    why = (
        NOTHING_RECORDED
        if not one.rows
        else one.found.why or (not_read(one.found.unseen_s) if one.found.unseen else None)
    )
    return PortCount(station, port, found if why is None else None, found, why)


def _write(counted: Counted) -> None:
    sys.stdout.write(json_line(asdict(counted)) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
