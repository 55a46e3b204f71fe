"""Progress of a run: a table on a terminal, lines elsewhere, printed by a thread that may block."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from math import floor
from pathlib import Path
from queue import Full, Queue
from typing import TYPE_CHECKING, Final

from jbclog.app.run.unit_feed import unit_after
from jbclog.cli.options import Color
from jbclog.cli.output import is_terminal
from jbclog.cli.terminal import Column, Printer, fitting_table, moment, span_of, started_live
from jbclog.core.clock import SystemClock
from jbclog.core.goal import JOINTS, Goal
from jbclog.core.operating_system import takes_text
from jbclog.core.rows import EventRow, PortKey, Severity
from jbclog.core.states import StationOutcome
from jbclog.core.text import units_text

if TYPE_CHECKING:
    from rich.console import Group
    from rich.live import Live

    from jbclog.app.run.options import Metadata
    from jbclog.live.joint_numbers import JointNumbers
    from jbclog.live.states import Joints
    from jbclog.session.run.context import SessionContext
    from jbclog.session.run.state import PortState

SHOWN = (Severity.WARNING, Severity.ERROR, Severity.CRITICAL)
ALSO_SHOWN = (
    *(
        "station.ready",
        "link.back",
        "robot.on",
        "unit.begin",
        "unit.again",
        "unit.finish",
        "unit.next",
        "run.goal",
    ),
    "alarm.episode.cleared",
)
COLUMNS: Final = (
    Column("station"),
    Column("port"),
    Column("now", is_number=True),
    Column("set", is_number=True, dropped=3),
    Column("status"),
    Column("alarms", is_number=True),
    Column("joints", is_number=True, dropped=2),
    Column("coverage", is_number=True, dropped=4),
    Column("lost", is_number=True, dropped=1),
)
MOST_NOTES: Final = 3  # reasons below the table
UNSAFE, SAFE = "safety.not_safe", "safety.safe_state"


def event_line(event: EventRow, job: str | None = None) -> str:
    """Return an event as one line: time of day, severity, job of a batch, station, text."""
    text = event.text.removeprefix(f"{event.station}: ")
    of = "" if job is None else f"{job}: "
    return (
        f"{moment(event.time / 1e6)}  {event.severity.value:8}  {of}{event.station or 'run'}:"
        f" {text}"
    )


class EventFilter:
    """Selects the events to show; a safe state only after a report that the tool was not safe."""

    def __init__(self) -> None:
        self._unsafe: set[tuple[str | None, int | None]] = set()

    def passes(self, event: EventRow) -> bool:
        place = (event.station, event.port)
        if event.kind == UNSAFE:
            self._unsafe.add(place)
        elif event.kind == SAFE and place in self._unsafe:
            self._unsafe.remove(place)
            return True
        return event.severity in SHOWN or event.kind in ALSO_SHOWN


class Lines:
    """Lines for a log or a pipe, one for each event worth showing."""

    def __init__(self, printer: Printer) -> None:
        self._printer = printer
        self._filter = EventFilter()

    def begun(self, folder: Path) -> None:
        self._printer.print(f"recording into {folder}")

    def happened(self, event: EventRow) -> None:
        if self._filter.passes(event):
            self._printer.print(event_line(event), event.severity)

    def second(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> None:
        return

    def sealing(self) -> None:
        self.close()
        self._printer.print("finalizing the record")

    def close(self) -> None:
        return


class Screen(Lines):
    """Live table for a terminal, with the events above it. A process beside the run counts the
    joints (`live.joint_numbers`).
    """

    def __init__(self, printer: Printer, duration_s: float | None, known: Metadata | None) -> None:
        super().__init__(printer)
        self._duration_s = duration_s
        self._order = known.order if known else None
        self._units: Sequence[str] = known.units if known else ()
        self._began = time.monotonic()
        self._live: Live | None = None
        self._joints: JointNumbers | None = None

    def begun(self, folder: Path) -> None:
        self._printer.print(
            f"recording into {folder}; Ctrl-C ends the run and makes the tools safe"
        )
        from jbclog.live.joint_numbers import JointNumbers

        self._joints = JointNumbers(folder, SystemClock())
        self._live = started_live(self._printer.console)

    def happened(self, event: EventRow) -> None:
        super().happened(event)
        unit = unit_after(event, None)
        if unit or event.kind == "unit.end":
            self._units = (unit,) if unit else ()

    def second(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> None:
        if self._live is not None:
            self._live.update(self._table(contexts, goals), refresh=True)

    def close(self) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None
        if self._joints is not None:
            self._joints.close()
            self._joints = None

    def _table(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> Group:
        joints = self._joints_of(contexts)
        rows = [cells for context in contexts for cells in _cells(context, joints)]
        title = [span_of(time.monotonic() - self._began, self._duration_s), *map(goal_text, goals)]
        title += [
            text
            for text in (f"order {self._order}" if self._order else "", units_text(self._units))
            if text
        ]
        return fitting_table(
            " · ".join(title), COLUMNS, rows, self._printer.console.width, joints_notes(joints)
        )

    def _joints_of(self, contexts: list[SessionContext]) -> dict[PortKey, Joints]:
        if self._joints is None:
            return {}
        found, rest = self._joints.look(has_ended=False), self._joints.not_counted
        return {
            key: found.get(key, rest)
            for context in contexts
            for key in ((context.name, port) for port in context.state.ports)
        }


def goal_text(goal: Goal) -> str:
    """Return ``3 of 40 units``; ``17 of 200 joints so far``, which is provisional; ``to 200
    joints`` before the first count.
    """
    if goal.reached is None:
        return f"to {goal.wanted} {goal.what}"
    return f"{goal.reached} of {goal.wanted} {goal.what}{' so far' if goal.what == JOINTS else ''}"


def coverage_text(due: int, obtained: int) -> str:
    """Return readings obtained of those due: ``99.8 %``. Never rounded up to 100 %."""
    if not due:
        return "unknown"
    return f"{floor(1000 * obtained / due) / 10:.1f} %"


def _cells(context: SessionContext, joints: Mapping[PortKey, Joints]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each port of a recorded station; one row for a station that is not recorded.

    Alarms are counted per station, in its first row. Lost are readings that were due and not
    obtained. Joints are those that had ended some seconds ago.
    """
    state = context.state
    alarms = str(state.facts.alarms or "")
    if state.facts.outcome != StationOutcome.RUNNING or not state.ports:
        ports = ", ".join(map(str, state.ports))
        yield (
            context.name,
            ports,
            "",
            "",
            "starting" if state.facts.outcome == StationOutcome.RUNNING else state.facts.outcome,
            alarms,
            *[""] * 3,
        )
        return
    for port in state.ports.values():
        setting = state.setpoint_c(port)
        wanted = "" if setting is None else f"{setting:g} °C"
        due, obtained = state.count_readings(port.number)
        counts = coverage_text(due, obtained), str(due - obtained or "")
        found = joints_text(joints.get((context.name, port.number)))
        yield (
            context.name,
            str(port.number),
            _tip(context, port),
            wanted,
            _status(context, port),
            alarms,
            found,
            *counts,
        )
        alarms = ""


def joints_text(joints: Joints | None) -> str:
    """Return a port's joints; a dash before the first count, nothing for a tool that makes none."""
    if joints is None or not joints.is_supported:
        return ""
    if joints.is_awaited:
        return "–"
    return "unknown" if joints.count is None else str(joints.count)


def joints_notes(joints: Mapping[PortKey, Joints]) -> list[str]:
    """Return the age of an older count, and why joints are unknown: a line for each reason."""
    from jbclog.app.watch.words import joints_age

    ports: dict[str, list[str]] = {}
    for (station, port), one in joints.items():
        if one.is_supported and not one.is_awaited and one.why:
            ports.setdefault(one.why, []).append(f"{station} port {port}")
    ages = {
        age.strip(" ()") for one in joints.values() if one.is_supported and (age := joints_age(one))
    }
    lines = [f"joints unknown, {', '.join(of)}: {why}" for why, of in ports.items()]
    more = (
        [
            f"joints of other ports are unknown for {len(lines) - MOST_NOTES} more reasons; `jbclog"
            " watch` has them"
        ]
        if len(lines) > MOST_NOTES
        else []
    )
    return [*(f"joints: counted {age}" for age in sorted(ages)), *lines[:MOST_NOTES], *more]


def _tip(context: SessionContext, port: PortState) -> str:
    if context.state.family.command_of("temperature_c") is None:
        return ""
    known = context.state.connected and port.temperature_c is not None
    return f"{port.temperature_c} °C" if known else "unknown"


def _status(context: SessionContext, port: PortState) -> str:
    if not context.state.connected:
        return "disconnected"
    if port.states:  # OMEGA, one word per signal
        return ", ".join(
            str(port.states[signal.name][0])
            for signal in context.state.family.signals
            if signal.name in port.states
        )
    if port.status is None:
        return "unknown"
    return context.state.family.status.state(port.status)


def observer(
    duration_s: float | None,
    color: Color = Color.AUTO,
    *,
    quiet: bool,
    known: Metadata | None = None,
) -> Lines:
    """Return the live table on a terminal, lines elsewhere and with --json. `known`: metadata
    stated before the run.
    """
    printer = Printer(color)
    return Screen(printer, duration_s, known) if is_terminal() and not quiet else Lines(printer)


# -- background observer ---------------------------------------------------------------------------
# A terminal stopped by Ctrl-S, or a pipe that nobody reads, must not block the run: the guard ends
# a run that stalls for 2 s.

STDERR: Final = 2
WAITING_MOST: Final = 1000  # notifications while stderr blocks; the record has all of them
LOOK_S: Final = 0.2
CLOSE_S: Final = 2.0

Notification = Callable[[], None]


class BackgroundObserver:
    """Forwards the notifications of a run to `observer` in a thread, as soon as stderr accepts
    text. `close` ends it.
    """

    def __init__(self, observer: Lines) -> None:
        self._observer = observer
        self._waiting: Queue[Notification | None] = Queue(WAITING_MOST)
        self._is_closing = False
        self._is_held = False
        self._dropped = 0
        self._thread = threading.Thread(target=self._forward, name="observer", daemon=True)
        self._thread.start()

    def begun(self, folder: Path) -> None:
        self._enqueue(lambda: self._observer.begun(folder))

    def happened(self, event: EventRow) -> None:
        self._enqueue(lambda: self._observer.happened(event))

    def second(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> None:
        if self._waiting.empty():  # skip a table that would not be seen
            self._enqueue(lambda: self._observer.second(contexts, goals))

    def sealing(self) -> None:
        self._enqueue(self._observer.sealing)

    def missed(self) -> int:
        """Return how many notifications have not been shown so far."""
        return self._dropped + (self._waiting.qsize() + 1 if self._is_held else 0)

    def close(self) -> None:
        """Show what is queued, for at most `CLOSE_S`; then stop."""
        end = time.monotonic() + CLOSE_S
        for last in (self._observer.close, None):
            with suppress(Full):
                self._waiting.put(last, timeout=max(end - time.monotonic(), 0.0))
        self._thread.join(max(end - time.monotonic(), 0.0))
        self._is_closing = True

    def _enqueue(self, notification: Notification) -> None:
        try:
            self._waiting.put_nowait(notification)
        except Full:
            self._dropped += 1

    def _forward(self) -> None:
        while (notify := self._waiting.get()) is not None:
            while not takes_text(STDERR, LOOK_S) and not self._is_closing:
                self._is_held = True
            self._is_held = False
            if self._is_closing:
                continue
            try:
                notify()
            except Exception:  # a lost terminal must not end the run
                self._dropped += 1
