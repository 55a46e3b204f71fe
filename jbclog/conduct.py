"""One run from its folder to its exit code: the record, the sessions, the signals, the seal, the verdict.

::

    create_run -> LiveStore -> Reactor(run_station × n) -> close -> seal -> judge -> manifest

Nothing is sent to any station before the record is known to take writes; the tools are in their safe state before the
record is closed.
"""

from __future__ import annotations

import gc
import getpass
import platform
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FrameType
from typing import Protocol

from jbclog import __version__
from jbclog.clock import SystemClock, UtcOffset
from jbclog.drive.reactor import Reactor
from jbclog.errors import RecordError
from jbclog.judge import Evidence, judge
from jbclog.outcome import Exit, Finding, exit_code, findings, status
from jbclog.plan import Plan, orders
from jbclog.record.conclude import conclude
from jbclog.record.folder import create_run, keep_text
from jbclog.record.ledger import ledger_of
from jbclog.record.live import SEAL_S, LiveStore
from jbclog.record.manifest import LineFile, Manifest, Metadata, RecipeFile, iso, write_manifest
from jbclog.record.seal import seal_in_child
from jbclog.rows import CounterRow, EventRow, SampleRow, SettingRow, Severity, StationFacts
from jbclog.session.order import Desk
from jbclog.session.run import run_station
from jbclog.transport import Port, open_port
from jbclog.transport.descriptors import allow_ports

LOOK_EVERY_S = 1.0  # at the wall clock, at progress
CUT_SHORT = {signal.SIGINT: Exit.INTERRUPTED, signal.SIGTERM: Exit.TERMINATED, signal.SIGHUP: Exit.TERMINATED}


class Observer(Protocol):
    """Who looks on: the command line's progress. Nothing that it does can change the run."""

    def begun(self, folder: Path) -> None: ...

    def happened(self, event: EventRow) -> None: ...

    def second(self, desks: list[Desk]) -> None: ...

    def sealing(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Result:
    """What a run came to."""

    folder: Path
    exit_code: Exit
    findings: list[Finding]
    manifest: Manifest


def conduct(plan: Plan, out: Path, observer: Observer, *, seal_every_s: float = SEAL_S) -> Result:
    """Run `plan` and record it below `out`. Raises `RecordError` where the record cannot even be begun."""
    return _Run(plan, out, observer, seal_every_s).conduct()


class _Run:
    """The state of one run while it goes on."""

    def __init__(self, plan: Plan, out: Path, observer: Observer, seal_every_s: float) -> None:
        self._plan = plan
        self._observer = observer
        self._clock = SystemClock()
        self._utc = UtcOffset(self._clock)
        self._t0 = self._clock.monotonic()
        allow_ports(len(plan.stations))
        self._folder = create_run(out, plan.line.name, self._clock.utc())
        self._reactor = Reactor()
        self._cut_short: Exit | None = None
        self._store = LiveStore(self._folder, self._on_record_failure, seal_every_s=seal_every_s)
        self._journal = _Tap(self._store, observer)
        self._manifest = self._begin_manifest()
        self._desks = [Desk(order, self._journal, self._utc) for order in orders(plan, self._t0)]
        self._have_all_begun = False

    def conduct(self) -> Result:
        with self._signals():
            self._keep_files()
            self._store.start()
            self._show(lambda: self._observer.begun(self._folder))
            count = len(self._desks)
            stations = f"{count} station{'' if count == 1 else 's'}"
            self._note("run.start", f"Run of {stations} on line {self._plan.line.name}, jbclog {__version__}.")
            broken = self._pull()
            record = self._close_record() or broken
            return self._conclude(record)

    # -- before -------------------------------------------------------------------------------------------------------------

    def _keep_files(self) -> None:
        keep_text(self._folder, "line.toml", self._plan.line.text)
        for name, recipe in self._plan.recipes.items():
            keep_text(self._folder, f"recipes/{name}", recipe.text)
        self._manifest.stations = [desk.facts for desk in self._desks]  # from here on others can see whose ports this run holds
        write_manifest(self._folder, self._manifest)

    def _begin_manifest(self) -> Manifest:
        line, told = self._plan.line, self._plan.wanted.metadata
        return Manifest(
            run=self._folder.name,
            started=iso(self._utc.micros(self._t0)),
            t0_mono=self._t0,
            t0_utc=self._t0 + self._utc.offset,
            line=LineFile(line.name, "line.toml", line.sha256),
            recipes=[RecipeFile(f"recipes/{name}", one.sha256, one.name, one.revision) for name, one in self._plan.recipes.items()],
            metadata=Metadata(told.operator, told.order, told.product, list(told.units), dict(told.tags)),
            host=_host(),
            rate=self._plan.wanted.rate,
        )

    # -- during -------------------------------------------------------------------------------------------------------------

    def _pull(self) -> str | None:
        """Run all sessions to their ends; what broke in this program meanwhile, or None."""
        for desk in self._desks:
            self._reactor.add(run_station(desk), _opener(desk))
        self._reactor.every(LOOK_EVERY_S, self._look)
        try:
            self._reactor.run()
        except Exception as error:  # the record of what went before is closed all the same
            text = f"internal error, {type(error).__name__}: {error}"
            self._note("run.failed", text, Severity.CRITICAL)
            return text
        finally:
            gc.unfreeze()
        return None

    def _look(self) -> None:
        if not self._have_all_begun:
            self._keep_from_collector()
        step = self._utc.check()
        if step:
            text = f"The host's clock was stepped by {step:+.3f} s; ticks and durations are not affected."
            self._note("clock.step", text, Severity.WARNING, value=step)
        self._show(lambda: self._observer.second(self._desks))

    def _keep_from_collector(self) -> None:
        """What the sessions have built stays to the end; to walk through it for garbage takes 40 ms of 250 stations' ticks."""
        gc.freeze()
        self._have_all_begun = all(desk.facts.first_tick is not None or desk.facts.outcome != "running" for desk in self._desks)

    @staticmethod
    def _show(show: Callable[[], None]) -> None:
        """A terminal that is gone must not become a fault of the run."""
        with suppress(Exception):
            show()

    def _on_record_failure(self, error: RecordError) -> None:
        """From the store's thread: what can no longer be recorded must not go on heating."""
        self._in_loop(self._reactor.end, f"the record cannot be kept: {error}")

    def _in_loop(self, call: Callable[[str], None], what: str) -> None:
        """Have it done in the loop's thread; where the loop has ended there is nothing left to do."""
        with suppress(RuntimeError):
            self._reactor.loop.call_soon_threadsafe(call, what)

    @contextmanager
    def _signals(self) -> Iterator[None]:
        """SIGINT, SIGTERM and SIGHUP end the run in good order; a second one, or one while sealing, changes nothing."""
        told = {number: signal.signal(number, self._on_signal) for number in CUT_SHORT}
        try:
            yield
        finally:
            for number, before in told.items():
                signal.signal(number, before)

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        self._in_loop(self._end_on, signal.Signals(number).name)

    def _end_on(self, name: str) -> None:
        if self._plan.wanted.duration_s is not None and self._cut_short is None:
            self._cut_short = CUT_SHORT[signal.Signals[name]]
        self._note("run.signal", f"{name} received; the tools are put in their safe state and the run ends.")
        self._reactor.end(f"ended by {name}")

    def _note(self, kind: str, text: str, severity: Severity = Severity.INFO, value: float | None = None) -> None:
        self._journal.event(EventRow(self._utc.micros(self._clock.monotonic()), kind, severity, text, value=value))

    # -- after --------------------------------------------------------------------------------------------------------------

    def _close_record(self) -> str | None:
        """Close the live store and seal its rows; what the record lacks, or None."""
        self._note("run.end", "All stations have ended.")
        self._store.close()
        self._show(self._observer.sealing)
        failure = str(self._store.failure) if self._store.failure else None
        try:
            seal_in_child(self._folder, self._store.lock)
        except RecordError as error:
            return failure or f"{error}; `jbclog recover {self._folder}` tries again"
        return failure

    def _conclude(self, record: str | None) -> Result:
        """Judge what is sealed, and write the manifest that is never changed again."""
        stations, manifest = [desk.facts for desk in self._desks], self._manifest
        manifest.stations = stations  # in the line file's order
        manifest.ended = iso(self._utc.micros(self._clock.monotonic()))
        verdict = self._verdict(stations, record)
        found = findings(stations, verdict=verdict, record=record, cut_short=self._cut_short)
        manifest.exit_code, manifest.exit_status = exit_code(found), status(found)
        try:
            self._manifest = conclude(self._folder, manifest, self._store.lock)
        except RecordError as error:
            found.append(Finding(Exit.RECORD, f"{error}; `jbclog recover {self._folder}` tries again"))
        finally:
            self._store.release()
        return Result(self._folder, exit_code(found), found, self._manifest)

    def _verdict(self, stations: list[StationFacts], record: str | None) -> str:
        exit_status = status(findings(stations, verdict=None, record=record, cut_short=self._cut_short))
        evidence = Evidence(self._folder, stations, ledger_of(self._folder, stations), exit_status, record)
        judgement = judge(evidence, {one.spec.name: one.recipe.acceptance for one in self._plan.stations})
        self._manifest.verdict = judgement.verdict.value
        self._manifest.verdict_rules = judgement.rules_as_dicts()
        return judgement.verdict.value


class _Tap:
    """A journal that lets the observer see the events that pass."""

    def __init__(self, store: LiveStore, observer: Observer) -> None:
        self.sample: Callable[[SampleRow], None] = store.sample
        self.setting: Callable[[SettingRow], None] = store.setting
        self.counter: Callable[[CounterRow], None] = store.counter
        self.facts: Callable[[StationFacts], None] = store.facts
        self._store = store
        self._observer = observer

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        self._store.event(event, at_once=at_once)
        with suppress(Exception):  # a terminal that is gone must not become a fault of a session
            self._observer.happened(event)


def _opener(desk: Desk) -> Callable[[], Port]:
    order = desk.order
    return lambda: open_port(order.url, order.line)


def _host() -> dict[str, str]:
    """Where this runs and with which versions."""
    found = {
        "name": socket.gethostname(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "jbclog": __version__,
    }
    try:
        found["user"] = getpass.getuser()
    except (KeyError, OSError):
        found["user"] = "unknown"
    for package in ("pyserial", "pyarrow"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found
