"""Carries out one run on real ports, from the record's begin to the exit code.

::

    RunRecord -> Reactor(run_station × n) -> close -> seal -> judge -> manifest

Nothing is sent to a station before the record takes writes; the tools are in their safe state
before the record is closed.
"""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from jbclog import __version__
from jbclog.app.run.goals import Goals
from jbclog.app.run.identities import Identities
from jbclog.app.run.plan import Plan
from jbclog.app.run.run_record import Observer, Result, RunRecord
from jbclog.app.run.unit_feed import LOOK_EVERY_S as LOOK_FOR_UNITS_S
from jbclog.app.run.unit_feed import UnitFeed
from jbclog.core.clock import SystemClock
from jbclog.core.errors import (
    RecordError,
    StartRefused,
    unexpected_error_text,
)
from jbclog.core.locks import is_held
from jbclog.core.outcome import CUT_SHORT, Exit
from jbclog.core.rows import EventRow, Severity, StationFacts
from jbclog.core.states import StationOutcome
from jbclog.core.text import count_text
from jbclog.guard.open_leases import LIST_STEP, about_list, settle
from jbclog.guard.supervisor import RunGuard
from jbclog.guard.watch import RENEW_S
from jbclog.record.guard_actions import LOCK as GUARD_LOCK
from jbclog.record.guard_actions import action_log, on_run_clock
from jbclog.record.manifest import iso
from jbclog.session.run.context import SessionContext
from jbclog.session.run.identity import alike, swapped, swapped_text
from jbclog.session.run.station_run import run_station
from jbclog.transport.opening import open_port
from jbclog.transport.port import Port
from jbclog.transport.reactor import Reactor
from jbclog.transport.signals import Signals
from jbclog.transport.system_ports import SharedPortWatch
from jbclog.transport.typed_lines import LineSource

if TYPE_CHECKING:  # imported with --capture
    from jbclog.record.wire_recorder import Head, WireRecorder

GUARDED, NO_GUARD, GUARD_LOST = "on", "none", "lost"  # values in the manifest
FIRST_PROCESS = 1  # process id in a container; the system ends all other processes with it
OF_A_CONTAINER = (
    "This recorder is the first process of its container: whatever kills it ends its guard with it."
    " Start the container with an init process (`docker run --init`)."
)
LOOK_EVERY_S = 1.0
LOOK_AT_PORTS_EVERY_S = 10.0  # interval of looks for other programs that have the ports open


class Recorder:
    """A run in progress in `folder`; `guarding` is its guard, which may have begun.

    `missed` returns how many messages could not be shown; `units` reads the serials of units.
    """

    def __init__(
        self,
        plan: Plan,
        out: Path,
        observer: Observer,
        seal_every_s: float,
        missed: Callable[[], int],
        units: LineSource | None,
        folder: Path,
        guarding: RunGuard,
    ) -> None:
        self._plan = plan
        self._missed = missed
        self._clock = SystemClock()
        self._guarding = guarding
        # tools that earlier runs left hot on these ports are made safe first
        self._left_over = settle(out, {station.spec.url for station in plan.stations}, is_held)
        self._run_record = RunRecord(
            plan,
            out,
            observer,
            self._clock,
            self._on_record_failure,
            seal_every_s,
            on_facts=self._update_guard,
            folder=folder,
        )
        self._note = self._run_record.note
        self._contexts = self._run_record.contexts
        self._identities = Identities(plan.line, self._contexts)
        self._reactor = Reactor(
            allow_missing=plan.starts_without_missing, report=self._note_failed_look
        )
        self._sharers = SharedPortWatch(context.order.url for context in self._contexts)
        self._wire = self._capturing() if plan.wanted.wire else None
        self._units = None if units is None else self._unit_feed(units)
        self._goals = Goals(plan.wanted.goals(), self._note, self._reactor.end, self._units)
        self._cut_short: Exit | None = None
        self._have_all_begun = False

    def _unit_feed(self, source: LineSource) -> UnitFeed:
        plan = self._plan
        return UnitFeed(
            source,
            self._keep_at_once,
            self._micros,
            plan.wanted.until_units,
            refuses_repeats=any(one.recipe.units.repeat == "refuse" for one in plan.stations),
        )

    @property
    def stations(self) -> list[StationFacts]:
        """What is known of each station."""
        return [context.state.facts for context in self._contexts]

    def conduct(self, signals: Signals) -> Result:
        """Run from the guard's start to the final manifest; `signals` end the run in good order."""
        signals.notify(self._on_signal)
        try:
            self._start_guard()
        except StartRefused as refusal:
            return self._refuse(str(refusal))
        self._begin()
        error = self._run_sessions()
        self._note_mix_ups()
        self._end_units()
        self._close_capture()
        self._note_missed()
        lacking = self._run_record.close() or error
        self._run_record.manifest.goals = self._goals.reached()
        return self._run_record.conclude(lacking, self._cut_short)

    def _begin(self) -> None:
        manifest = self._run_record.manifest
        manifest.stations = self.stations  # others can now see whose ports this run holds
        manifest.wire = None if self._wire is None else "open"
        manifest.guard = GUARDED if self._plan.wanted.guard else NO_GUARD
        self._run_record.begin()
        self._goals.begin(self._run_record.folder)
        for left in self._left_over:
            # by an earlier run: no deviation of this one, unless a tool may still be hot
            self._note(
                "guard.left_over",
                left.text,
                Severity.WARNING if left.is_safe else Severity.CRITICAL,
            )
        if not self._plan.wanted.guard:
            self._note(
                "guard.none",
                "There is no guard: if this recorder dies, the tools stay as they are.",
                Severity.WARNING,
            )
            return
        if os.getpid() == FIRST_PROCESS:
            self._note("guard.weak", OF_A_CONTAINER, Severity.WARNING)
        is_listed, text = about_list(self._run_record.folder)
        if text:
            self._note(
                "guard.list",
                f"Open leases {text}; {LIST_STEP}.",
                Severity.INFO if is_listed else Severity.WARNING,
            )

    def _start_guard(self) -> None:
        """Wait for the guard before the record begins and anything heats. Raises `StartRefused`."""
        if self._plan.wanted.guard:
            self._guarding.start(self._run_record.folder, self._note_guard)

    def _refuse(self, why: str) -> Result:
        self._guarding.end()
        self._reactor.run()  # without sessions: it closes what it opened
        with suppress(OSError):
            (self._run_record.folder / GUARD_LOCK).unlink(missing_ok=True)
        return self._run_record.refuse(
            {context.name: f"{context.name}: {why}" for context in self._contexts}
        )

    def _note_guard(self, kind: str, text: str) -> None:
        self._run_record.manifest.guard = GUARD_LOST
        self._note(kind, text, Severity.CRITICAL)

    # -- during ------------------------------------------------------------------------------------

    def _run_sessions(self) -> str | None:
        """Run all sessions to their ends; return the internal error that ended them, or None."""
        for context in self._contexts:
            self._add(context)
        if self._wire is not None:
            self._wire.start()
        every = self._reactor.every
        for look, what in self._looks():
            every(LOOK_EVERY_S, look, what)
        every(LOOK_AT_PORTS_EVERY_S, self._sharers.look, "Look for other programs on the ports")
        every(RENEW_S, self._renew_guard, "Sign of life to the guard")
        if self._units is not None:
            every(LOOK_FOR_UNITS_S, self._look_for_units, "Look for serials of units")
        try:
            self._reactor.run(self._guarding.end)
        except Exception as error:  # the record so far must still be closed
            text = f"internal error, {unexpected_error_text(error)}"
            self._note("run.failed", text, Severity.CRITICAL)
            self._have_guard_take_over()
            return text
        finally:
            gc.unfreeze()
        return None

    def _update_guard(self, facts: StationFacts) -> None:
        self._guarding.update(facts)
        if facts.touched and facts.name not in self._identities:  # later proofs go with the beat
            self._send_identities()

    def _renew_guard(self) -> None:
        self._send_identities()
        self._guarding.renew()

    def _send_identities(self) -> None:
        self._guarding.identify(self._identities.families(), self._identities.proofs())

    def _have_guard_take_over(self) -> None:
        """Let the guard make the tools safe, as sessions may be unfinished; its actions become
        events of this record.
        """
        self._guarding.take_over()
        for event in on_run_clock(
            action_log(self._run_record.folder), self._run_record.manifest.clock_steps
        ):
            self._run_record.journal.event(event)

    def _add(self, context: SessionContext) -> None:
        """Add a station's session to the reactor, with a serial capture if requested."""
        order = context.order

        def opened() -> Port:
            port = open_port(order.url, order.line)
            self._identities.note_opened(order.name, port)
            return port

        if self._wire is None:
            self._reactor.add(run_station(context), opened, order.name)
            return
        from jbclog.transport.session_history import Tee, captured

        keep, now = self._wire.begin(self._head(context)), self._clock.monotonic
        self._reactor.add(
            captured(run_station(context), keep, now),
            lambda: Tee.opened(opened, keep, now),
            order.name,
        )

    def _capturing(self) -> WireRecorder:
        from jbclog.record.wire_recorder import WireRecorder

        return WireRecorder(self._run_record.folder)

    def _head(self, context: SessionContext) -> Head:
        from jbclog.record.wire_recorder import Head

        order, manifest = context.order, self._run_record.manifest
        return Head(
            station=order.name,
            url=order.url,
            recipe=order.recipe_file,
            t0_mono=order.t0,
            t0_utc=manifest.t0_utc or 0.0,
            duration_s=order.duration_s,
            rate=order.rate,
            allow_omega_write=order.allow_omega_write,
            allow_missing=order.may_be_missing,
            jbclog=__version__,
        )

    def _looks(self) -> Iterator[tuple[Callable[[], None], str]]:
        """Yield what is called each second, each with its name. They are called one by one: an
        error in one must not keep the others from running.
        """
        yield self._freeze_sessions, "Freeze the sessions"
        yield self._look_at_clock, "Look at the clock"
        yield self._note_capture, "Look at the capture"
        yield self._note_sharers, "Report other programs on the ports"
        yield self._note_mix_ups, "Compare the stations' identities"
        yield self._run_record.look, "Look at the disk"
        yield self._goals.look, "Look at the goals"
        yield self._show, "Show the run"

    def _show(self) -> None:
        self._run_record.show(
            lambda: self._run_record.observer.second(self._contexts, self._goals.so_far())
        )

    def _note_failed_look(self, text: str) -> None:
        hint = "it is tried again (set JBCLOG_TRACEBACK=1 to see where; please report it)"
        self._note("run.look_failed", f"{text}. The run continues, and {hint}.", Severity.WARNING)

    def _note_sharers(self) -> None:
        for url, who in self._sharers.news():
            for context in self._contexts:
                if (
                    context.order.url == url
                    and context.state.facts.outcome == StationOutcome.RUNNING
                ):
                    text = (
                        f"{url} is open in {who}, too, which may take answers that were meant for"
                        " this run; end that program."
                    )
                    context.log.note("link.contention", Severity.ERROR, text)

    def _note_mix_ups(self) -> None:
        """Give the sessions the stations that look alike, and report swapped cables once."""
        names = alike(self._contexts)
        for context in self._contexts:
            context.state.alike = names.get(context.name, [])
        for first, second in swapped(self._contexts):
            text = swapped_text(first, second)
            for context in (first, second):
                if context.state.mix_up != text:
                    context.state.mix_up = text
                    context.log.note(
                        "identity.swapped", Severity.CRITICAL, f"{text[0].upper()}{text[1:]}."
                    )
                if context.state.facts.outcome == StationOutcome.REFUSED:
                    context.state.facts.reason = f"{context.name}: {text}"

    def _look_at_clock(self) -> None:
        utc = self._run_record.utc
        now = self._clock.monotonic()
        before = iso(utc.host_micros(now))
        step = utc.check()
        if step:
            after = iso(utc.host_micros(now))
            text = (
                f"The host's clock was stepped by {step:+.3f} s, from {before} to {after}. The"
                f" times of this run continue: {iso(utc.micros(now))}."
            )
            self._note("clock.step", text, Severity.WARNING, value=step, raw=after)
            self._run_record.keep_step(utc.micros(now), step)

    def _freeze_sessions(self) -> None:
        """Freeze the sessions for the garbage collector, once all have begun: a full pass would
        delay 250 stations by 40 ms.
        """
        if self._have_all_begun:
            return
        gc.freeze()
        self._have_all_begun = all(
            context.state.facts.first_tick is not None
            or context.state.facts.outcome != StationOutcome.RUNNING
            for context in self._contexts
        )

    def _note_capture(self) -> None:
        trouble = None if self._wire is None else self._wire.news()
        if trouble is not None:
            self._note("wire.failed", trouble, Severity.WARNING)

    def _close_capture(self) -> None:
        if self._wire is not None:
            from jbclog.record.wire import WHOLE

            self._wire.close()
            self._note_capture()
            self._run_record.manifest.wire = self._wire.trouble or WHOLE

    def _look_for_units(self) -> None:
        if self._units is not None:
            self._units.look()
            self._goals.look()

    def _keep_at_once(self, event: EventRow) -> None:
        self._run_record.journal.event(event, at_once=True)

    def _micros(self) -> int:
        return self._run_record.utc.micros(self._clock.monotonic())

    def _end_units(self) -> None:
        """Finish the feed of serials; record a required unit that never came."""
        if self._units is None:
            return
        self._units.finish()
        given = self._plan.wanted.metadata and self._plan.wanted.metadata.units
        if not (self._units.has_had_any or given) and any(
            "unit" in one.recipe.metadata.required for one in self._plan.stations
        ):
            self._note(
                "unit.missing",
                "The recipe requires a unit, and no serial came during the run.",
                Severity.ERROR,
            )

    def _note_missed(self) -> None:
        missed = self._missed()
        if missed:
            text = (
                f"{count_text(missed, 'message')} of this run {'was' if missed == 1 else 'were'}"
                " not shown, because nothing read them from the terminal, pipe or file. All are in"
                " these events."
            )
            self._note("notes.missed", text, value=missed)

    def _on_record_failure(self, error: RecordError) -> None:
        """End the run, called from the store's thread: no tool may stay hot unrecorded."""
        self._in_loop(self._reactor.end, f"the record cannot be kept: {error}")

    def _in_loop(self, call: Callable[[str], None], what: str) -> None:
        """Call it in the loop's thread; does nothing after the loop's end."""
        with suppress(RuntimeError):
            self._reactor.loop.call_soon_threadsafe(call, what)

    def _on_signal(self, number: signal.Signals) -> None:
        self._in_loop(self._end_on, number.name)

    def _end_on(self, name: str) -> None:
        if self._plan.wanted.states_an_end and not self._goals.is_met and self._cut_short is None:
            self._cut_short = CUT_SHORT[signal.Signals[name]]
        self._note(
            "run.signal",
            f"{name} received; the tools are put in their safe state and the run ends.",
        )
        self._reactor.end(f"ended by {name}")
