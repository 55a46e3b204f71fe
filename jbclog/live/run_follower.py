"""Follows one run: reads new rows of its record and returns its state. Start with
`RunFollower.poll`.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.core.clock import Clock, SystemClock
from jbclog.core.errors import RecordError
from jbclog.core.locks import is_held
from jbclog.core.rows import SCHEMA_VERSION, StationFacts
from jbclog.live.event_history import EventHistory, SettingHistory
from jbclog.live.joint_numbers import JointNumbers
from jbclog.live.record_follower import RecordFollower
from jbclog.live.recorder_clock import DELAYED_S, RecorderClock
from jbclog.live.sample_history import SampleHistory
from jbclog.live.states import NOT_COUNTED, Phase, RunState
from jbclog.live.view import RunView
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import Manifest, merged_facts, read_manifest
from jbclog.record.row_batches import keep_pandas_out

EARLIER_S: Final = 0.1  # CPU time for older rows at each poll
STARTING_S: Final = 5.0  # longest time from the creation of a folder to its first commit
STARTING: Final = "The run begins; nothing is recorded yet."
CRASHED: Final = (
    "The recorder ended without finalizing; tools may be hot. `jbclog recover` finishes the record."
)


class RunFollower:
    """Follows the run in `folder`. Reads only, takes no lock, and may be stopped or killed at any
    step.

    Call `poll` about twice a second and `close` at the end. `clock` is for tests; `joints` starts a
    process that counts the joints.
    """

    def __init__(self, folder: Path, clock: Clock | None = None, *, joints: bool = False) -> None:
        self.folder = folder
        keep_pandas_out()
        self._clock = RecorderClock(clock or SystemClock())
        self._manifest: Manifest | None = None
        self._manifest_is: tuple[int, ...] = ()
        self._trouble = ""
        self._folder_is = _identity(folder)
        self._is_other_run = False
        self._joints = JointNumbers(folder, clock or SystemClock()) if joints else None
        self._record = RecordFollower(folder, self._take)
        self._samples = SampleHistory()
        self._events = EventHistory()
        self._settings = SettingHistory()

    def close(self) -> None:
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
        try:
            phase, text = self._read()
            self._trouble = ""
        except (RecordError, OSError) as error:
            phase, text, self._trouble = Phase.UNREADABLE, str(error), str(error)
        return self._view().state(phase, text)

    def _view(self) -> RunView:
        dropped = self._record.notes.get("dropped")
        return RunView(
            folder=self.folder,
            manifest=self._manifest,
            clock=self._clock,
            stations=self._stations(),
            samples=self._samples,
            events=self._events,
            settings=self._settings,
            joints={} if self._joints is None else self._joints.look(has_ended=self._is_sealed),
            not_counted=NOT_COUNTED if self._joints is None else self._joints.not_counted,
            damage=self._record.damage,
            dropped_rows=dropped if isinstance(dropped, int) else 0,
            is_whole=self._record.is_whole,
        )

    def _stations(self) -> list[StationFacts]:
        """Return the facts of each station in the manifest's order; those of an ended session come
        from the manifest.
        """
        planned = [] if self._manifest is None else self._manifest.stations
        return merged_facts(planned, self._record.facts)

    @property
    def _is_sealed(self) -> bool:
        return self._manifest is not None and self._manifest.is_sealed

    # -- reading -----------------------------------------------------------------------------------

    def _read(self) -> tuple[Phase, str]:
        """Read what is new and return the phase. Raises `RecordError`, OSError."""
        if not self.folder.is_dir():
            return Phase.GONE, "The run's folder was removed."
        self._read_manifest()
        was_sealed = self._is_sealed
        self._read_rows()
        is_alive = was_sealed or self._is_recorder_alive()
        self._read_manifest()  # after the lock: a run is sealed before its lock is released
        if self._is_sealed and not was_sealed:
            self._read_rows()  # its last rows are in parts now
        self._read_earlier()
        if self._is_sealed:
            return Phase.FINALIZED, "The run has ended and is finalized."
        return self._phase_of_recorder() if is_alive else (Phase.CRASHED, CRASHED)

    def _read_rows(self) -> None:
        self._record.read(self._manifest)
        schema = self._record.notes.get("schema")
        if isinstance(schema, int) and schema > SCHEMA_VERSION:
            raise RecordError(
                f"{self.folder}: written with schema {schema}; this jbclog knows {SCHEMA_VERSION}."
                " Use a newer jbclog."
            )
        mark = self._record.mark
        self._clock.see(None if mark is None else mark.utc_us / 1e6)

    def _read_earlier(self) -> None:
        """Read sealed samples for `EARLIER_S`."""
        until = time.monotonic() + EARLIER_S
        while time.monotonic() < until and self._record.read_earlier():
            pass

    def _take(self, table: str, rows: pa.Table) -> None:
        if table == "samples":
            periods = {facts.name: facts.period_s for facts in self._stations()}
            self._samples.add(rows, periods)
        elif table == "events":
            self._events.add(rows)
        elif table == "settings":
            self._settings.add_settings(rows)
        else:
            self._settings.add_counters(rows)

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
            starts = {read.start for read in (before, self._manifest) if read and read.start}
            self._is_other_run = self._is_other_run or len(starts) > 1

    # -- the recorder ------------------------------------------------------------------------------

    def _phase_of_recorder(self) -> tuple[Phase, str]:
        """Return the phase of a run whose recorder lives."""
        age = self._clock.age_s
        if self._record.notes.get("closed"):
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
        is_starting = self._clock.age_s is None and self._clock.waited_s < STARTING_S
        if self._clock.is_alive or is_starting:
            return True
        try:
            return is_held(self.folder)
        except OSError as error:
            raise RecordError(
                f"{self.folder}: its lock cannot be read: {error.strerror or error}"
            ) from error


def _identity(folder: Path) -> tuple[int, int] | None:
    """Return what tells a folder from another of the same name; None if there is none."""
    try:
        there = folder.stat()
    except OSError:
        return None
    return there.st_dev, there.st_ino
