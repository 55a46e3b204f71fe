"""What a run shows while it goes on, on a terminal or as lines, from a thread that may wait."""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from queue import Full, Queue
from typing import TYPE_CHECKING, Final

from jbclog.cli.output import is_terminal, note, wrapped
from jbclog.core.rows import EventRow, Severity
from jbclog.core.text import clean
from jbclog.session.run.context import PortState, SessionContext

if TYPE_CHECKING:
    from rich.live import Live
    from rich.table import Table

# -- progress -----------------------------------------------------------------------------------------------------------------

WORTH_TELLING = (Severity.WARNING, Severity.ERROR, Severity.CRITICAL)
RUNNING = "running"  # the outcome of a station that has none yet
GOOD_NEWS = (
    *("station.ready", "link.back", "robot.on", "unit.begin", "unit.again", "unit.finish", "unit.next", "run.goal"),
    "alarm.episode.cleared",
)
UNSAFE, SAFE = "safety.not_safe", "safety.safe_state"


def event_line(event: EventRow) -> str:
    """An event as one line of notes: time of day in UTC, where, what."""
    moment = time.strftime("%H:%M:%S", time.gmtime(event.time // 1_000_000))
    text = event.text.removeprefix(f"{event.station}: ")
    return f"{moment}Z  {event.severity.value:8}  {event.station or 'run'}: {text}"


class Worth:
    """Which events a person wants to hear of while a run goes on; of a tool's safe state, where it was told not to be in it."""

    def __init__(self) -> None:
        self._unsafe: set[tuple[str | None, int | None]] = set()

    def telling(self, event: EventRow) -> bool:
        place = (event.station, event.port)
        if event.kind == UNSAFE:
            self._unsafe.add(place)
        elif event.kind == SAFE and place in self._unsafe:
            self._unsafe.remove(place)
            return True
        return event.severity in WORTH_TELLING or event.kind in GOOD_NEWS


class Lines:
    """For a log or a pipe: a line for each event worth telling."""

    def __init__(self) -> None:
        self._worth = Worth()

    def begun(self, folder: Path) -> None:
        note(f"recording into {folder}")

    def happened(self, event: EventRow) -> None:
        if self._worth.telling(event):
            note(event_line(event))

    def second(self, contexts: list[SessionContext]) -> None:
        return

    def sealing(self) -> None:
        note("sealing the record")

    def close(self) -> None:
        return


class Screen:
    """For a person: a table that is renewed each second, events above it."""

    def __init__(self, duration_s: float | None) -> None:
        from rich.console import Console

        self._console = Console(stderr=True, no_color="NO_COLOR" in os.environ, highlight=False)
        self._worth = Worth()
        self._duration_s = duration_s
        self._began = time.monotonic()
        self._live: Live | None = None

    def begun(self, folder: Path) -> None:
        from rich.live import Live

        self._print(f"recording into {folder}; Ctrl-C ends the run and makes the tools safe")
        # stdout is for data: what is told there must not be shown on stderr because a table is
        self._live = Live(console=self._console, auto_refresh=False, transient=True, redirect_stdout=False, redirect_stderr=False)
        self._live.start()

    def happened(self, event: EventRow) -> None:
        if self._worth.telling(event):
            self._print(event_line(event))

    def second(self, contexts: list[SessionContext]) -> None:
        if self._live is not None:
            self._live.update(self._table(contexts), refresh=True)

    def sealing(self) -> None:
        self.close()
        self._print("sealing the record")

    def close(self) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _print(self, text: str) -> None:
        self._console.print(wrapped(clean(text), self._console.width), markup=False, soft_wrap=True)

    def _table(self, contexts: list[SessionContext]) -> Table:
        from rich.table import Table

        passed = time.monotonic() - self._began
        total = "" if self._duration_s is None else f" of {self._duration_s:g} s"
        table = Table(title=f"{passed:.0f} s{total}", title_justify="left", pad_edge=False)
        for name in ("station", "port", "now", "set", "status", "alarms", "link"):
            table.add_column(name, justify="right" if name in ("now", "set", "alarms") else "left")
        for context in contexts:
            for cells in _cells(context):
                table.add_row(*map(clean, cells))
        return table


def _cells(context: SessionContext) -> Iterator[tuple[str, ...]]:
    """A row for each port of a station that is recorded; one for a station that is not yet, or not any more."""
    alarms = str(context.facts.alarms or "")
    if context.facts.outcome != RUNNING or not context.ports:
        ports = ", ".join(map(str, context.ports))
        yield context.name, ports, "", "", "", alarms, "starting" if context.facts.outcome == RUNNING else context.facts.outcome
        return
    for port in context.ports.values():
        setting = context.set_c(port)
        wanted = "" if setting is None else f"{setting:g} °C"
        link = "connected" if context.connected else "away"
        yield context.name, str(port.number), _tip(context, port), wanted, _status(context, port), alarms, link
        alarms = ""  # they are counted by station


def _tip(context: SessionContext, port: PortState) -> str:
    if context.family.command_of("temperature_c") is None:
        return ""
    known = context.connected and port.temperature_c is not None
    return f"{port.temperature_c} °C" if known else "unknown"


def _status(context: SessionContext, port: PortState) -> str:
    if context.connected and port.states:  # OMEGA's, each in its own words
        return ", ".join(str(port.states[signal.name][0]) for signal in context.family.signals if signal.name in port.states)
    if not context.connected or port.status is None:
        return "unknown"
    return context.family.status.state(port.status)


def observer(duration_s: float | None, *, quiet: bool) -> Lines | Screen:
    """The table on a terminal, lines elsewhere or where stdout is for a program."""
    return Screen(duration_s) if is_terminal() and not quiet else Lines()


# -- background observer ------------------------------------------------------------------------------------------------------
# An observer told in a thread of its own: a terminal that is held (Ctrl-S), or a pipe that nobody reads, must not hold the run.
#
# A run that stands still for two seconds is ended by its guard; so nothing that people are told may make it wait.

STDERR: Final = 2
WAITING_MOST: Final = 1000  # what is told while nobody listens; the record has it all
LOOK_S: Final = 0.2
CLOSE_S: Final = 2.0

Told = Callable[[], None]


class BackgroundObserver:
    """Tells `observer` what a run tells, as soon as stderr takes it. Ends with `close`."""

    def __init__(self, observer: Lines | Screen) -> None:
        self._observer = observer
        self._waiting: Queue[Told | None] = Queue(WAITING_MOST)
        self._is_closing = False
        self._is_held = False
        self._dropped = 0
        self._thread = threading.Thread(target=self._tell_on, name="observer", daemon=True)
        self._thread.start()

    def begun(self, folder: Path) -> None:
        self._tell(lambda: self._observer.begun(folder))

    def happened(self, event: EventRow) -> None:
        self._tell(lambda: self._observer.happened(event))

    def second(self, contexts: list[SessionContext]) -> None:
        if self._waiting.empty():  # a table that is not seen need not be made
            self._tell(lambda: self._observer.second(contexts))

    def sealing(self) -> None:
        self._tell(self._observer.sealing)

    def missed(self) -> int:
        """How many of the things that it was told it could not show so far."""
        return self._dropped + (self._waiting.qsize() + 1 if self._is_held else 0)

    def close(self) -> None:
        """Let what waits be told, if it can be; then no more."""
        end = time.monotonic() + CLOSE_S
        for last in (self._observer.close, None):
            with suppress(Full):
                self._waiting.put(last, timeout=max(end - time.monotonic(), 0.0))
        self._thread.join(max(end - time.monotonic(), 0.0))
        self._is_closing = True

    def _tell(self, told: Told) -> None:
        try:
            self._waiting.put_nowait(told)
        except Full:
            self._dropped += 1

    def _tell_on(self) -> None:
        while (told := self._waiting.get()) is not None:
            while not _takes_text() and not self._is_closing:
                self._is_held = True
            self._is_held = False
            if self._is_closing:
                continue
            try:
                told()
            except Exception:  # a terminal that is gone must not become a fault of the run
                self._dropped += 1


def _takes_text() -> bool:
    """Whether stderr takes some text within `LOOK_S`; one that is closed takes any."""
    watched = select.poll()
    watched.register(STDERR, select.POLLOUT)
    return bool(watched.poll(LOOK_S * 1000))
