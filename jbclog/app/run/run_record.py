"""The record of one run: its folder, journal, seal, verdict and manifest.

::

    RunRecord() -> begin -> (the sessions) -> close -> conclude
"""

from __future__ import annotations

import getpass
import os
import platform
import socket
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import pyarrow

from jbclog import __version__
from jbclog.analysis.alarms.live import LiveAlarms
from jbclog.analysis.rules_number import RULES
from jbclog.app.run.options import Metadata as GivenMetadata
from jbclog.app.run.plan import PORTS, Plan, StationPlan
from jbclog.app.run.tasks import station_tasks
from jbclog.core.clock import Clock, UtcOffset, utc_of
from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.core.goal import Goal
from jbclog.core.outcome import Exit, RunFinding, exit_code, findings, status
from jbclog.core.rows import (
    COLUMN,
    CounterRow,
    EventRow,
    SampleRow,
    SettingRow,
    Severity,
    StationFacts,
    TipCheck,
)
from jbclog.core.states import StationOutcome
from jbclog.core.text import count_text
from jbclog.maintenance.verification import cited
from jbclog.record.chains import previous_run
from jbclog.record.folder import create_run, keep_text
from jbclog.record.manifest import (
    ClockStep,
    LineFile,
    Manifest,
    Metadata,
    RecipeFile,
    expect_readable,
    iso,
    write_manifest,
)
from jbclog.record.run_journal import OnFailure, RunJournal
from jbclog.record.seal_child import SEAL_S, seal_in_child
from jbclog.session.run.context import SessionContext
from jbclog.transport.opening import PYSERIAL

OnFacts = Callable[[StationFacts], None]
NOT_STARTED = "The run was not started."


class Observer(Protocol):
    """Shows the progress of a run; cannot change it.

    `happened` is called in a thread of the record, after the record has the event.
    """

    def begun(self, folder: Path) -> None: ...

    def happened(self, event: EventRow) -> None: ...

    def second(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> None: ...

    def sealing(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a run."""

    folder: Path
    exit_code: Exit
    findings: list[RunFinding]
    manifest: Manifest


class RunRecord:
    """The record of one run of `plan`, in the new `folder` below `out`, created here if None. Times
    are those of `clock`.

    `on_facts` gets the facts of a session before the session continues. `on_failure` is called in a
    thread of the record when rows cannot be stored. Raises `RecordError` if the record cannot
    begin.
    """

    def __init__(
        self,
        plan: Plan,
        out: Path,
        observer: Observer,
        clock: Clock,
        on_failure: OnFailure | None = None,
        seal_every_s: float | None = SEAL_S,
        on_facts: OnFacts | None = None,
        folder: Path | None = None,
    ) -> None:
        self.clock = clock
        self.utc = UtcOffset(clock)
        self.t0 = clock.monotonic()
        self.observer = observer
        self.folder = folder or create_run(out, plan.line.name, clock.utc())
        previous = previous_run(out, plan.line.name, self.folder)
        self._plan = plan
        self._is_remedy_given = False  # in the text that `close` returns
        self._store = RunJournal(
            self.folder, on_failure, seal_every_s=seal_every_s, on_event=observer.happened
        )
        self.journal = _Tap(self._store, on_facts)
        self.manifest = replace(self._draft(), previous=previous)
        self._out = out
        self.manifest.verifications = self._cited(self.utc.micros(self.t0))
        self.contexts = [
            SessionContext.of(order, self.journal, self.utc)
            for order in station_tasks(plan, self.t0)
        ]

    def begin(self) -> None:
        """Copy the inputs and begin to take rows. Raises `RecordError`, before any station is
        touched.
        """
        try:
            expect_readable(self.manifest)
            keep_text(self.folder, "line.toml", self._plan.line.text)
            for name, recipe in self._plan.recipes.items():
                keep_text(self.folder, f"recipes/{name}", recipe.text)
            write_manifest(self.folder, self.manifest)
        except RecordError as error:
            raise RecordError(f"{error}. No station was touched.") from error
        self._store.start()
        self.show(lambda: self.observer.begun(self.folder))
        count = len(self.contexts)
        stations = count_text(count, "station")
        self.note(
            "run.start", f"Run of {stations} on line {self._plan.line.name}, jbclog {__version__}."
        )

    def look(self) -> None:
        """Check whether the disk delays the record. Call it every second; never waits."""
        self._store.check_stall()

    def _draft(self) -> Manifest:
        line = self._plan.line
        return Manifest(
            run=self.folder.name,
            rules=RULES,
            start=iso(self.utc.micros(self.t0)),
            t0_mono=self.t0,
            t0_utc=self.t0 + self.utc.offset,
            clock_steps=[],
            line=LineFile(line.name, "line.toml", line.sha256),
            recipes=[
                RecipeFile(f"recipes/{name}", one.sha256, one.name, one.revision)
                for name, one in self._plan.recipes.items()
            ],
            metadata=_metadata(self._plan.wanted.metadata or GivenMetadata()),
            host=_host(),
            rate=self._plan.wanted.rate,
            goals=self._plan.wanted.goals(),
        )

    def keep_step(self, time: int, step_s: float) -> None:
        """List a step of the host's clock in the manifest; `time` by the run's clock, in µs."""
        steps = self.manifest.clock_steps or []
        before_s = steps[-1].offset_s if steps else 0.0
        self.manifest.clock_steps = [
            *steps,
            ClockStep(iso(time), step_s, round(before_s + step_s, 6)),
        ]

    def _cited(self, start_us: int) -> list[TipCheck]:
        """Return the tip verification of each assumed port in force at the start, UTC in µs; which
        ports exist is known at the end.
        """
        places = [(one.spec.name, port) for one in self._plan.stations for port in _ports(one)]
        tips = {place: self.manifest.metadata.tip(*place) for place in places}
        return cited(self._out, places, tips, utc_of(start_us))

    def note(
        self,
        kind: str,
        text: str,
        severity: Severity = Severity.INFO,
        value: float | None = None,
        raw: str | None = None,
    ) -> None:
        """Record an event of the whole run; a critical one at once."""
        time = self.utc.micros(self.clock.monotonic())
        event = EventRow(time, kind, severity, text, value=value, raw=raw)
        self.journal.event(event, at_once=severity is Severity.CRITICAL)

    @staticmethod
    def show(show: Callable[[], None]) -> None:
        """Call the observer: a lost terminal must not fail the run."""
        with suppress(Exception):
            show()

    def refuse(self, why: Mapping[str, str]) -> Result:
        """Record a run that is not started, with the reasons by station."""
        for context in self.contexts:
            context.state.facts.outcome = StationOutcome.REFUSED
            context.state.facts.reason = why.get(
                context.name, f"{context.name}: not asked, for the run was not started"
            )
        self.manifest.stations = [context.state.facts for context in self.contexts]
        self.manifest.goals = [
            replace(goal, reached=0, text=NOT_STARTED) for goal in self.manifest.goals
        ]
        self.begin()
        for context in self.contexts:
            context.station.now = self.clock.monotonic()  # no session has set its time
            context.log.note(
                "station.refused",
                Severity.ERROR,
                context.state.facts.reason.removeprefix(f"{context.name}: "),
            )
            context.publish()
        return self.conclude(self.close())

    # -- end ---------------------------------------------------------------------------------------

    def close(self) -> str | None:
        """Close the journal and seal its rows; return what the record lacks, or None."""
        self.note("run.end", "All stations have ended.")
        self._store.close()
        self.show(self.observer.sealing)
        failure = str(self._store.failure) if self._store.failure else None
        try:
            self._store.lock.expect_ours()
            seal_in_child(self.folder, self._store.lock)
        except RecordError as error:
            if failure is None or not self._store.lock.is_ours:
                self._is_remedy_given = True
                return self._failure_text(error)
        return failure

    def conclude(self, record: str | None, cut_short: Exit | None = None) -> Result:
        """Judge the sealed rows and write the final manifest. `record` is what the record lacks."""
        # imported only now: reading sealed tables takes memory that hours of recording do without
        from jbclog.app.run.ending import conclude, judge_run
        from jbclog.record.clock_steps import HostClock

        stations, manifest = [context.state.facts for context in self.contexts], self.manifest
        manifest.stations = stations  # in the line file's order
        start_us = self.utc.micros(self.t0)
        true_start_us = HostClock(manifest.clock_steps or (), manifest.start).corrected(start_us)
        if true_start_us != start_us:
            manifest.verifications = self._cited(true_start_us)
        there = {facts.name: facts.ports for facts in stations}
        manifest.verifications = [
            one for one in manifest.verifications if one.port in (there[one.station] or [one.port])
        ]
        manifest.stop = iso(self.utc.micros(self.clock.monotonic()))
        judge_run(self.folder, self._plan, manifest, record, cut_short)
        found = findings(
            stations,
            verdict=manifest.verdict,
            record=record,
            cut_short=cut_short,
            goals=manifest.goals,
        )
        manifest.exit_code, manifest.exit_status = exit_code(found), status(found)
        try:
            self.manifest = conclude(self.folder, manifest, self._store.lock)
        except RecordError as error:
            if not self._is_remedy_given:
                found.append(RunFinding(Exit.RECORD, self._failure_text(error)))
        finally:
            self._store.release()
        return Result(self.folder, exit_code(found), found, self.manifest)

    def _failure_text(self, error: RecordError) -> str:
        """Return what failed and what to do about it."""
        if self._store.lock.is_ours:
            return f"{error}; `jbclog recover {self.folder}` tries again"
        return (
            f"{error}. If it was moved, `jbclog recover` finishes it where it is now; if it was"
            " deleted, nothing of it is left"
        )


class _Tap:
    """A journal that also passes rows to the alarm evaluation, which adds events, and facts to
    `on_facts`.
    """

    def __init__(self, store: RunJournal, on_facts: OnFacts | None) -> None:
        self.counter: Callable[[CounterRow], None] = store.counter
        self._alarms: LiveAlarms | None = LiveAlarms(store.event)
        self._on_facts = on_facts
        self._store = store
        self._keep_sample = store.sample

    def sample(self, row: SampleRow) -> None:
        self._keep_sample(row)
        if self._alarms is not None:
            try:
                self._alarms.sample(row)
            # an internal error; derived events must not end the recording
            except Exception as error:
                self._without_alarms(row, error)

    def setting(self, setting: SettingRow) -> None:
        self._store.setting(setting)
        if self._alarms is not None:
            self._alarms.setting(setting)

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        self._store.event(event, at_once=at_once)
        if self._alarms is not None:
            self._alarms.event(event)

    def facts(self, facts: StationFacts) -> None:
        self._store.facts(facts)
        if self._alarms is not None:
            self._alarms.facts(facts)
        if self._on_facts is not None:
            self._on_facts(facts)

    def _without_alarms(self, row: SampleRow, error: Exception) -> None:
        self._alarms = None
        text = (
            "Alarms on samples are not evaluated for the rest of this run: internal error,"
            f" {unexpected_error_text(error)}."
        )
        time = row[COLUMN["time"]]
        assert isinstance(time, int)
        self._store.event(EventRow(time, "alarm.episode.failed", Severity.WARNING, text))


def _ports(station: StationPlan) -> Sequence[int]:
    """Return all ports that the station can have, if only the station knows them."""
    return station.spec.ports or (station.family.ports if station.family else None) or PORTS


def _metadata(given: GivenMetadata) -> Metadata:
    lots = list(given.wire_lots), list(given.flux_lots)
    return Metadata(
        given.operator,
        given.order,
        given.product,
        list(given.units),
        dict(given.tags),
        *lots,
        list(given.tips),
    )


def _host() -> dict[str, str]:
    found = {
        "name": socket.gethostname(),
        "system": _system(),
        "python": platform.python_version(),
        "jbclog": __version__,
    }
    try:
        found["user"] = getpass.getuser()
    except (KeyError, OSError):
        found["user"] = "unknown"
    return found | {"pyserial": PYSERIAL, "pyarrow": pyarrow.__version__}


def _system() -> str:
    """Return what `platform.platform()` does, without the processor's name, for which it starts a
    process on Linux.
    """
    if sys.platform != "linux":
        return platform.platform()
    its = os.uname()
    parts = (its.sysname, its.release, its.machine, "with", "".join(platform.libc_ver()))
    return "-".join(filter(None, parts))
