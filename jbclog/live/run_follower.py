"""Follows one run: reads new rows of its record and returns its state. Start with
`RunFollower.poll`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.core.clock import Clock, SystemClock
from jbclog.core.errors import RecordError
from jbclog.core.locks import commit_status, is_held
from jbclog.core.rows import TABLES, StationFacts
from jbclog.live.event_history import EventHistory, SettingHistory
from jbclog.live.heartbeat import DELAYED_S, Heartbeat
from jbclog.live.joint_numbers import JointNumbers
from jbclog.live.sample_history import SampleHistory
from jbclog.live.states import NOT_COUNTED, Phase, RunState
from jbclog.live.store_follower import Sealed, StoreFollower
from jbclog.live.view import RunView
from jbclog.record.batches import keep_pandas_out
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import Manifest, facts_in, merged_facts, read_manifest
from jbclog.record.part_file import open_part
from jbclog.record.parts import Seals, group_of, groups_of, part_paths, parts_through

NEWEST_BATCHES: Final = 90  # batches of samples: more than a minute of commits
NEWEST_GROUPS: Final = 2  # row groups of a sealed run: more than 32 000 rows
EARLIER_S: Final = 0.1  # CPU time for older rows at each poll
STARTING_S: Final = 5.0  # longest time from the creation of a folder to its first commit
TRIES: Final = 5
STARTING: Final = "The run begins; nothing is recorded yet."
CRASHED: Final = (
    "The recorder ended without finalizing; tools may be hot. `jbclog recover` finishes the record."
)
NOT_ALL_COMMITTED: Final = (Phase.STARTING, Phase.RECORDING, Phase.DELAYED)


class RunFollower:
    """Follows the run in `folder`. Reads only, takes no lock, and may be stopped or killed at any
    step.

    Call `poll` about twice a second and `close` at the end. `clock` is for tests; `joints` starts a
    process that counts the joints.
    """

    def __init__(self, folder: Path, clock: Clock | None = None, *, joints: bool = False) -> None:
        self.folder = folder
        keep_pandas_out()
        self._clock = clock or SystemClock()
        self._heartbeat = Heartbeat(self._clock)
        self._manifest: Manifest | None = None
        self._manifest_is: tuple[int, ...] = ()
        self._trouble = ""
        self._folder_is, self._is_other_run = _identity(folder), False
        self._joints = JointNumbers(folder, self._clock) if joints else None
        self._begin()

    def _begin(self) -> None:
        """Drop everything read so far."""
        self._store = StoreFollower(self.folder)
        self._facts: dict[str, StationFacts] = {}
        self._samples, self._events, self._settings = (
            SampleHistory(),
            EventHistory(),
            SettingHistory(),
        )
        self._earlier: Iterator[pa.Table] = iter(())
        self._is_begun = self._is_whole = self._is_from_parts = False

    def close(self) -> None:
        self._store.close()
        if self._joints is not None:
            self._joints.close()

    def was_replaced(self) -> bool:
        """Whether the folder has another run now, under the name of the one that was followed: what
        was read belongs to that one.
        """
        now = _identity(self.folder)
        return self._is_other_run or (now is not None and now != self._folder_is)

    def poll(self) -> RunState:
        """Read new rows and return the state of the run. Errors of the record become a phase."""
        status = commit_status(self.folder)
        self._heartbeat.see(status.since, status.took_s)
        try:
            phase, _ = self._phase()
            self._read(status.last if phase in NOT_ALL_COMMITTED else None)
            phase, text = self._phase()
            if self._is_sealed and not self._is_from_parts:
                self._read(None)  # sealed while reading: the store may have lacked the last rows
            self._trouble = ""
        except (RecordError, OSError) as error:
            phase, text, self._trouble = Phase.UNREADABLE, str(error), str(error)
        return self._view().state(phase, text)

    def _view(self) -> RunView:
        return RunView(
            folder=self.folder,
            manifest=self._manifest,
            heartbeat=self._heartbeat,
            stations=self._stations(),
            samples=self._samples,
            events=self._events,
            settings=self._settings,
            joints={} if self._joints is None else self._joints.look(has_ended=self._is_sealed),
            not_counted=NOT_COUNTED if self._joints is None else self._joints.not_counted,
            damage=self._store.damage,
            dropped_rows=self._store.dropped_rows,
            is_whole=self._is_whole,
        )

    def _stations(self) -> list[StationFacts]:
        """Return the facts of each station in the manifest's order; those of an ended session come
        from the manifest.
        """
        planned = [] if self._manifest is None else self._manifest.stations
        return merged_facts(planned, self._facts)

    # -- phase -------------------------------------------------------------------------------------

    @property
    def _is_sealed(self) -> bool:
        return self._manifest is not None and self._manifest.is_sealed

    def _phase(self) -> tuple[Phase, str]:
        if not self.folder.is_dir():
            return Phase.GONE, "The run's folder was removed."
        is_alive = self._is_recorder_alive()
        self._read_manifest()  # after the lock: a run is sealed before its lock is released
        if self._is_sealed:
            return Phase.FINALIZED, "The run has ended and is finalized."
        return self._phase_of_lock() if is_alive else (Phase.CRASHED, CRASHED)

    def _phase_of_lock(self) -> tuple[Phase, str]:
        """Return the phase of a run whose recorder is alive."""
        age = self._heartbeat.age_s
        if self._store.is_closed:
            return Phase.FINALIZING, "The run has ended; its record is being finalized."
        if age is None:
            return Phase.STARTING, STARTING
        if age < DELAYED_S:
            return Phase.RECORDING, "Recording."
        return (
            Phase.DELAYED,
            f"Nothing was stored for {age:.0f} s: the disk or the recorder is delayed.",
        )

    def _is_recorder_alive(self) -> bool:
        """Test the lock only if nothing else answers: the test holds the lock for a moment."""
        if self._heartbeat.is_alive or (
            self._heartbeat.age_s is None and self._heartbeat.waited_s < STARTING_S
        ):
            return True
        try:
            return is_held(self.folder)
        except OSError as error:
            raise RecordError(
                f"{self.folder}: its lock cannot be read: {error.strerror or error}"
            ) from error

    def _read_manifest(self) -> None:
        """Read the whole manifest if it was replaced. Raises `RecordError`."""
        try:
            there = (self.folder / MANIFEST).lstat()
        except OSError:
            return
        identity = (there.st_ino, there.st_mtime_ns, there.st_size)
        if identity != self._manifest_is or self._trouble:
            before, self._manifest = self._manifest, read_manifest(self.folder)
            self._manifest_is = identity
            starts = {one.started for one in (before, self._manifest) if one and one.started}
            self._is_other_run = self._is_other_run or len(starts) > 1

    # -- reading -----------------------------------------------------------------------------------

    def _read(self, through: int | None) -> None:
        """Read new rows; begin again if batches have moved to sealed parts."""
        for _ in range(TRIES):
            try:
                if self._is_sealed:
                    self._read_sealed()
                else:
                    self._read_store(through)
                self._read_earlier()
                return
            except Sealed:
                self._store.close()
                self._begin()
                self._read_manifest()

    def _read_store(self, through: int | None) -> None:
        before = self._store.last
        new = self._store.refresh(through)
        self._take_facts()
        if not self._is_begun:
            if new or self._store.exists:
                self._read_first(new)
            return
        if new and before and new[0][0] > before + 1:
            raise Sealed
        for number, table in new:
            self._add(table, self._store.table(number))

    def _read_first(self, new: list[tuple[int, str]]) -> None:
        """Read the newest rows and all events; older samples follow in later polls."""
        parts = {table: part_paths(self.folder, table) for table in TABLES}
        sealed = {table: parts_through(paths) for table, paths in parts.items()}
        if (
            new
            and new[0][0] > max(*sealed.values(), 0) + 1
            and new[0][0] > self._store.sealed_through + 1
        ):
            raise Sealed  # a part was completed between the two looks
        for table in ("events", "settings", "counters"):
            for group in groups_of(parts[table]):
                self._add(table, group)
        live = [(number, table) for number, table in new if number > sealed[table]]
        samples = [number for number, table in live if table == "samples"]
        for number, table in live:
            if table != "samples" or number in samples[-NEWEST_BATCHES:]:
                self._add(table, self._store.table(number))
        self._earlier = self._older(samples[:-NEWEST_BATCHES][::-1], parts["samples"])
        self._is_begun = True

    def _older(self, batches: list[int], parts: list[Path]) -> Iterator[pa.Table]:
        """Yield older samples: first those in the live store (sealed hourly), then the parts."""
        for number in batches:
            table = self._store.table(number)
            if table is not None:
                yield table
        yield from groups_of(parts)

    def _read_sealed(self) -> None:
        """Read a finalized run from its parts, once."""
        if self._is_from_parts:
            return
        self._store.close()
        self._begin()
        seals = self._seals()
        for table in ("events", "settings", "counters"):
            for group in groups_of(part_paths(self.folder, table), seals=seals):
                self._add(table, group)
        groups = _groups_in(part_paths(self.folder, "samples"), seals)
        for path, index in groups[-NEWEST_GROUPS:]:
            self._add("samples", _group(path, index, seals))
        self._earlier = (_group(path, index, seals) for path, index in groups[:-NEWEST_GROUPS])
        self._is_begun = self._is_from_parts = True

    def _seals(self) -> Seals:
        files = [] if self._manifest is None else self._manifest.files
        return {self.folder / file.path: file for file in files}

    def _read_earlier(self) -> None:
        """Read older samples for `EARLIER_S`."""
        until = time.monotonic() + EARLIER_S
        while self._is_begun and not self._is_whole and time.monotonic() < until:
            rows = next(self._earlier, None)
            if rows is None:
                self._is_whole = True
            else:
                self._samples.add_earlier(rows, self._periods())

    def _add(self, table: str, rows: pa.Table | None) -> None:
        if rows is None or not len(rows):
            return
        if table == "samples":
            self._samples.add(rows, self._periods())
        elif table == "events":
            self._events.add(rows)
        elif table == "settings":
            self._settings.add_settings(rows)
        else:
            self._settings.add_counters(rows)

    def _periods(self) -> dict[str, float | None]:
        return {facts.name: facts.period_s for facts in self._stations()}

    def _take_facts(self) -> None:
        self._facts |= facts_in(self.folder, self._store.changed_facts())


def _identity(folder: Path) -> tuple[int, int] | None:
    """Return what tells a folder from another of the same name; None if there is none."""
    try:
        there = folder.stat()
    except OSError:
        return None
    return there.st_dev, there.st_ino


def stations_of(folder: Path, manifest: Manifest) -> list[StationFacts]:
    """Return the current facts of each station. Raises `RecordError`."""
    store = StoreFollower(folder)
    try:
        store.refresh(None)
        return merged_facts(manifest.stations, facts_in(folder, store.changed_facts()))
    finally:
        store.close()


def _groups_in(parts: list[Path], seals: Seals) -> list[tuple[Path, int]]:
    """Return part and number of each row group. Raises `RecordError`."""
    groups: list[tuple[Path, int]] = []
    for path in parts:
        with open_part(path, seals.get(path)) as part:
            groups += [(path, index) for index in range(part.num_row_groups)]
    return groups


def _group(path: Path, index: int, seals: Seals) -> pa.Table:
    with open_part(path, seals.get(path)) as part:
        return group_of(part, path.parent.name, index)
