"""Counts the joints of a run while it is recorded.

Identifying the tips' models (`identify`) is slow, so they are reused until the next time. In
between, `count` reads each new row once. A port without a sampling grid, or with a feeder, is
counted only when models are identified. A joint counts once it ended `ENDED_S` before its port's
last row.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.joints.evidence import (
    NOTHING_RECORDED,
    PortFound,
    ports_found,
)
from jbclog.analysis.joints.growing import GrowingPort
from jbclog.analysis.joints.parameters import options_of
from jbclog.analysis.joints.port_reader import raw_series
from jbclog.analysis.joints.port_rows import COLUMNS, Clock
from jbclog.analysis.port_split import by_port
from jbclog.analysis.verdict.evidence import not_read
from jbclog.analysis.verdict.rules import has_tip
from jbclog.core.errors import RecordError
from jbclog.core.locks import commit_status
from jbclog.core.rows import PortKey, StationFacts
from jbclog.live.joint_numbers import Counted, PortCount
from jbclog.live.run_follower import stations_of
from jbclog.live.states import OF_TIPS_ONLY
from jbclog.live.store_follower import Sealed, StoreFollower
from jbclog.record.clock_steps import COLUMNS as COLUMNS_OF_STEPS
from jbclog.record.clock_steps import KIND as STEP
from jbclog.record.folder import joints_asked
from jbclog.record.manifest import read_manifest
from jbclog.record.parts import groups_of, part_paths, parts_through

ENDED_S: Final = 1.5
TRIES: Final = 5
AT_ONCE: Final = 64  # batches read together: a commit of one station has few rows
AGAIN_AND_AGAIN: Final = "was sealed again and again"


class GrowingJoints:
    """Counts joints in `folder`. Call `identify` before `count`; both return a count."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._identified: dict[PortKey, PortFound] = {}
        self._stations: list[StationFacts] = []
        self._t0_utc: float | None = None
        self._store: StoreFollower | None = None
        self.close()

    def close(self) -> None:
        """Drop the rows read so far."""
        if self._store is not None:
            self._store.close()
        self._store, self._stepped_s = None, 0.0
        self._ports: dict[PortKey, GrowingPort] = {}

    def identify(self, through: int) -> Counted:
        """Identify the models in the rows up to a batch, and count. Raises `RecordError`."""
        counted, self._stations, self._identified, self._t0_utc = _found(self._folder, through)
        self.close()
        return counted

    def count(self, through: int) -> Counted:
        """Count in the rows up to a batch, with the identified models. Raises `RecordError`."""
        began = time.monotonic()
        for _ in range(TRIES):
            try:
                self._read(through)
                break
            except Sealed:
                self.close()
        else:
            raise RecordError(f"{self._folder} {AGAIN_AND_AGAIN}")
        newest_s = max((port.last_s for port in self._ports.values() if port.rows), default=None)
        ports = tuple(self._count(facts, port) for facts in self._stations for port in facts.ports)
        age_s = _age_s(newest_s, self._t0_utc, self._stepped_s)
        return Counted(age_s, ports, took_s=time.monotonic() - began)

    def _count(self, facts: StationFacts, number: int) -> PortCount:
        key = facts.name, number
        port = self._ports.get(key)
        if port is None:
            return _port(facts, number, self._identified.get(key), ENDED_S)
        draws, why, (unseen_s, unseen) = port.so_far()
        found = sum(draw.end_s <= port.last_s - ENDED_S for draw in draws)
        why = why or (not_read(unseen_s) if unseen else None)
        return _port_count(key, found, why if port.rows else NOTHING_RECORDED)

    def _read(self, through: int) -> None:
        """Read the new rows. Raises `Sealed` if some of them have moved to a part."""
        if self._store is None:
            self._begin(through)
            return
        before = self._store.last
        new = self._store.refresh(through)
        if before < through and (not new or new[0][0] > before + 1):
            raise Sealed
        for name, take in (("samples", self._take), ("events", self._step)):
            for rows in _joined(self._store, [number for number, of in new if of == name]):
                take(rows)

    def _begin(self, through: int) -> None:
        rows = OpenRows(self._folder, through)
        for facts in self._stations:
            options = options_of(joints_asked(self._folder, facts)) if has_tip(facts) else None
            for port in facts.ports:
                found = self._identified.get((facts.name, port))
                if options and found and found.identified and facts.period_s:
                    self._ports[facts.name, port] = GrowingPort(options, found.identified)
        for group in rows.groups("samples", COLUMNS):
            self._take(group)
        self._stepped_s = _stepped_s(rows.groups("events", COLUMNS_OF_STEPS))
        self._store = StoreFollower(self._folder)
        self._store.last = through

    def _take(self, rows: pa.Table) -> None:
        facts = {one.name: one for one in self._stations}
        for key, some in by_port(rows.select(COLUMNS)):
            if key in self._ports:
                clock = Clock(facts[key[0]].period_s, (), round((self._t0_utc or 0.0) * 1e6))
                self._ports[key].take(raw_series(facts[key[0]], some, clock))

    def _step(self, events: pa.Table) -> None:
        self._stepped_s += _stepped_s([events])


def _joined(
    store: StoreFollower, numbers: list[int], columns: list[str] | None = None
) -> Iterator[pa.Table]:
    """Yield the rows of these batches, several batches at once. `columns` None: all."""
    for first in range(0, len(numbers), AT_ONCE):
        read = [store.table(number) for number in numbers[first : first + AT_ONCE]]
        there = [one for one in read if one is not None]
        rows = there if columns is None else [one.select(columns) for one in there]
        if rows:
            yield pa.concat_tables(rows).combine_chunks()


def count(folder: Path, through: int | None = None, *, is_last: bool = False) -> Counted:
    """Count the joints of all ports up to a batch, as the report does; None: all committed rows.

    `is_last`: no more rows will come. Raises `RecordError`.
    """
    return _found(folder, through, is_last=is_last).counted


class _Found(NamedTuple):
    """Joints found in the rows up to a batch."""

    counted: Counted
    stations: list[StationFacts]
    ports: dict[PortKey, PortFound]
    t0_utc: float | None


def _found(folder: Path, through: int | None, *, is_last: bool = False) -> _Found:
    for _ in range(TRIES):
        began = time.monotonic()
        rows = OpenRows(folder, through or commit_status(folder).last or None)
        manifest = read_manifest(folder)
        is_final = is_last or manifest.is_sealed
        if is_final:
            rows = OpenRows(folder, None)
        stations, t0_utc = stations_of(folder, manifest), manifest.t0_utc
        try:
            found = ports_found(folder, rows.groups, stations, t0_utc)
            stepped_s = _stepped_s(rows.groups("events", COLUMNS_OF_STEPS))
        except Sealed:
            continue
        newest_s = max((one.last_s for one in found.values() if one.rows), default=None)
        age_s, ended_s = _age_s(newest_s, t0_utc, stepped_s), 0.0 if is_final else ENDED_S
        ports = tuple(
            _port(facts, port, found.get((facts.name, port)), ended_s)
            for facts in stations
            for port in facts.ports
        )
        counted = Counted(age_s, ports, is_final, time.monotonic() - began)
        return _Found(counted, stations, found, t0_utc)
    raise RecordError(f"{folder} {AGAIN_AND_AGAIN}")


def _stepped_s(events: Iterable[pa.Table]) -> float:
    """Return by how much the wall clock was stepped in all."""
    steps = (group.filter(pc.equal(group["kind"], STEP)) for group in events)
    return sum((pc.sum(some["value"]).as_py() or 0.0 for some in steps), start=0.0)


def _age_s(newest_s: float | None, t0_utc: float | None, stepped_s: float) -> float:
    """Return the age of the newest counted row, corrected for steps of the wall clock."""
    if newest_s is None or t0_utc is None:
        return 0.0
    return max(time.time() - t0_utc - stepped_s - newest_s, 0.0)


def _port(facts: StationFacts, number: int, one: PortFound | None, ended_s: float) -> PortCount:
    if one is None:
        return PortCount(facts.name, number, None, 0, OF_TIPS_ONLY)
    joints, last_s = one.found.joints, one.last_s
    found = sum(joint.end_s <= last_s - ended_s or not ended_s for joint in joints)
    why = one.found.why or (not_read(one.found.unseen_s) if one.found.unseen else None)
    return _port_count((facts.name, number), found, why if one.rows else NOTHING_RECORDED)


def _port_count(key: PortKey, found: int, why: str | None) -> PortCount:
    return PortCount(*key, found if why is None else None, found, why)


@dataclass(frozen=True, slots=True)
class OpenRows:
    """The rows of an unfinished run up to the batch `through` (None: all), table by table: sealed
    parts first, then the live store.

    If the run is sealed while it is read, `Sealed` is raised and the rows must be read again.
    """

    folder: Path
    through: int | None

    def groups(self, table: str, columns: list[str]) -> Iterator[pa.Table]:
        """Yield these columns of a table in order, in pieces. Raises `Sealed`, `RecordError`."""
        store = StoreFollower(self.folder)
        try:
            # before the parts, so that no row moves from store to part unseen
            batches = store.refresh(self.through)
            parts = part_paths(self.folder, table)
            sealed = parts_through(parts)
            yield from groups_of(parts, columns)
            live = [number for number, of in batches if of == table and number > sealed]
            yield from _joined(store, live, columns)
        finally:
            store.close()
