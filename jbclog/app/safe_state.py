"""Puts every tool of a line in its safe state on demand.

::

    runs that hold its ports -> SIGTERM, SIGKILL after 3 s -> guards at work on them try once more
    -> all stations in parallel, `make_safe` on each

A run that ends on SIGTERM makes its tools safe itself; after SIGKILL its guard does. Either way the
result is read back: nothing else counts as safe.
"""

from __future__ import annotations

import os
import select
import signal
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Final

from jbclog.app.connection import target_of
from jbclog.app.port_access import SYSTEM, PortAccess
from jbclog.config.line import Line
from jbclog.core.errors import (
    AnswerCorrupt,
    AnswerTimeout,
    JbclogError,
    RecordError,
    unexpected_error_text,
)
from jbclog.core.locks import is_held
from jbclog.guard import open_leases
from jbclog.guard.continuity import is_mixed
from jbclog.guard.inquiry import Inquiry, Unsafe
from jbclog.guard.lease import StationLease, families_leased
from jbclog.protocol.commands.feeder import FeederState
from jbclog.record.guard_actions import await_guard
from jbclog.record.port_owner import holds, recorder_of, runs_that_hold
from jbclog.session.manual.contact import Target
from jbclog.session.manual.safe import (
    MadeSafe,
    StationMadeSafe,
    make_safe,
    order_unanswered,
    temperatures,
)
from jbclog.transport.port import Port

TERM_S: Final = 3.0  # time for a run to release the line (docs/reference/commands.md, jbclog safe)
KILLED_S: Final = 2.0
GUARD_S: Final = 6.0  # a guard that takes over is done by then
LOOK_S: Final = 0.1
CONNECT_S: Final = 6.0  # another program may hold a port for a moment
AGAIN_S: Final = 0.25
DONE_S: Final = 20.0  # a port whose driver hangs must not delay the result of the others

COLD_WITHIN_S: Final = 1800.0
COLD_EVERY_S: Final = 5.0
REPORT_EVERY_S: Final = 60.0

Report = Callable[[str], None]


class HowEnded(StrEnum):
    ASKED = "asked"
    KILLED = "killed"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class EndedRun:
    """A run that held the line, and how it ended."""

    folder: Path
    how: HowEnded


def make_line_safe(
    line: Line,
    done: Callable[[StationMadeSafe], None],
    access: PortAccess = SYSTEM,
    guards: GuardsAtWork | None = None,
) -> None:
    """Put every tool of the line in its safe state, all stations in parallel; call `done` with each
    in the line's order. A station that one of `guards` has just tried is tried once.
    """
    found = [StationMadeSafe(target_of(line, station.name)) for station in line.stations]
    reports = [None if guards is None else guards.report(made.target.url) for made in found]
    threads = [
        Thread(target=_one, args=(made, access, report), daemon=True)
        for made, report in zip(found, reports, strict=True)
    ]
    for thread in threads:
        thread.start()
    end = time.monotonic() + DONE_S
    for thread, made in zip(threads, found, strict=True):
        thread.join(max(end - time.monotonic(), 0.0))
        if thread.is_alive():
            made = StationMadeSafe(made.target, problem="its port hangs: switch the station off")
        done(made)


def _one(
    made: StationMadeSafe, access: PortAccess, guard: tuple[Path, Unsafe] | None = None
) -> None:
    """Try to connect to the station for `CONNECT_S`, once if its guard has just done so; the result
    is in `made`.
    """
    end = access.clock.monotonic() + (CONNECT_S if guard is None else 0.0)
    _try_until(end, made, access)
    if guard is not None and not made.is_safe:
        folder, unsafe = guard
        texts = [f"port {port}: {text}" if port else text for port, text in unsafe.texts.items()]
        made.note = f"the guard of the run {folder} says: {'; '.join(texts)}"


def _try_until(end: float, made: StationMadeSafe, access: PortAccess) -> None:
    while True:
        try:
            access.run(make_safe(made.target, made), lambda: _open(made.target, access))
        except JbclogError as error:
            made.is_unanswered = isinstance(error.__cause__, AnswerTimeout | AnswerCorrupt)
            made.problem = (
                f"{_reason(error, made.target)}; its tools may be hot: switch the station off"
            )
        except Exception as error:  # the other stations must still be made safe
            made.problem = (
                f"internal error, {unexpected_error_text(error)}; its tools may be hot: switch the"
                " station off"
            )
        if made.is_safe or made.family is not None or access.clock.monotonic() > end:
            return
        access.sleep(AGAIN_S)
        made.problem = None


def _open(target: Target, access: PortAccess) -> Port:
    return access.open_port(target.url, target.line)


def _reason(error: JbclogError, target: Target) -> str:
    return str(error).removeprefix(f"{target.name}: ")


def close_leases(stations: Collection[StationMadeSafe], out: Path) -> list[Path]:
    """Report the states read back to this user's runs, and those below `out`, that left these tools
    hot; return the runs' folders.
    """
    by_lease = partial(_seen, stations)
    return open_leases.close(
        [made.target.url for made in stations], by_lease, is_held, "jbclog safe", out
    )


def _seen(stations: Collection[StationMadeSafe], lease: StationLease) -> open_leases.Seen | None:
    made = next((one for one in stations if lease.is_at(one.target.url)), None)
    if made is None or made.problem is not None:
        return None
    states: dict[int, str | None] = {tool.port: tool.state for tool in made.tools if tool.is_safe}
    return open_leases.Seen(
        made.model, states | dict.fromkeys(made.empty), made.feeder != FeederState.RUNNING
    )


# -- stations that do not answer -------------------------------------------------------------------


def unanswered(
    stations: Collection[StationMadeSafe], guards: GuardsAtWork
) -> list[StationMadeSafe]:
    """Return the stations that may be ordered although nothing proves them: nothing usable came,
    and no guard has ordered them, nor found another station there.
    """
    found = []
    for made in stations:
        report = guards.report(made.target.url)
        is_settled = report is not None and bool(report[1].orders or report[1].other)
        has_order = made.target.family is not None and bool(made.target.family.safe_states)
        if made.is_unanswered and made.family is None and has_order and not is_settled:
            found.append(made)
    return found


def why_mixed(line: Line) -> str | None:
    """Return why no station of the line may be ordered without an answer; None if all may."""
    families = {station.family for station in line.stations}
    elsewhere = families_leased()
    if not is_mixed(families, elsewhere):
        return None
    known = ", ".join(sorted(families | (elsewhere or set())))
    return (
        f"the line's stations ({known}), and those of runs that left tools hot, may take one order"
        " differently: it would switch hot air on"
    )


def insist(stations: Collection[StationMadeSafe], access: PortAccess = SYSTEM) -> None:
    """Order each station's own safe state once, without an answer, all in parallel; write it down
    in the runs that left them hot.
    """
    threads = [Thread(target=_insist, args=(made, access), daemon=True) for made in stations]
    for thread in threads:
        thread.start()
    end = time.monotonic() + DONE_S
    for thread in threads:
        thread.join(max(end - time.monotonic(), 0.0))
    for made in stations:
        texts = {tool.port: tool.problem or "" for tool in made.tools}
        open_leases.note_orders(made.target.url, texts, "jbclog safe --unanswered")


def _insist(made: StationMadeSafe, access: PortAccess) -> None:
    try:
        access.run(order_unanswered(made.target, made), lambda: _open(made.target, access))
    except JbclogError as error:
        made.problem = f"{_reason(error, made.target)}; nothing was sent: switch the station off"


# -- cooling ---------------------------------------------------------------------------------------


def wait_until_cold(
    stations: Collection[StationMadeSafe],
    below_c: float,
    report: Report,
    access: PortAccess = SYSTEM,
) -> float:
    """Read the temperatures until all are below `below_c`, `COLD_WITHIN_S` at most; return the
    seconds that this took.

    Sets `temperature_c` and `is_cold` of each tool. A tool whose temperature cannot be read is not
    cold. A port is open only while it is read, so that others can use it.
    """
    clock, waited = access.clock, [made for made in stations if made.tools]
    begun = reported_at = clock.monotonic()
    while True:
        _look_at_all(waited, below_c, access)
        warm = [
            f"{made.target.name} port {tool.port} {_celsius(tool)}"
            for made in waited
            for tool in made.tools
            if not tool.is_cold
        ]
        now = clock.monotonic()
        if not warm or now - begun >= COLD_WITHIN_S:
            return now - begun
        if now - reported_at >= REPORT_EVERY_S:
            reported_at = now
            report(f"waiting for {', '.join(warm)} to be below {below_c:g} °C")
        access.sleep(min(COLD_EVERY_S, begun + COLD_WITHIN_S - now))


def _celsius(tool: MadeSafe) -> str:
    return (
        "(temperature not known)" if tool.temperature_c is None else f"({tool.temperature_c:g} °C)"
    )


def _look_at_all(stations: Collection[StationMadeSafe], below_c: float, access: PortAccess) -> None:
    """Read all stations in parallel; a port that hangs delays no other, and counts as not cold."""
    threads = [Thread(target=_look, args=(made, below_c, access), daemon=True) for made in stations]
    for made, thread in zip(stations, threads, strict=True):
        for tool in made.tools:
            tool.is_cold, tool.temperature_c = False, None
        thread.start()
    end = time.monotonic() + DONE_S
    for thread in threads:
        thread.join(max(end - time.monotonic(), 0.0))


def _look(made: StationMadeSafe, below_c: float, access: PortAccess) -> None:
    steps = temperatures(made.target, made.model, tuple(tool.port for tool in made.tools))
    try:
        found = access.run(steps, lambda: _open(made.target, access))
    except JbclogError:
        return
    for tool in made.tools:
        tool.temperature_c = found.get(tool.port)
        tool.last_c = tool.last_c if tool.temperature_c is None else tool.temperature_c
        tool.is_cold = tool.temperature_c is not None and tool.temperature_c < below_c


# -- guards at work --------------------------------------------------------------------------------


class GuardsAtWork:
    """The guards that are making tools of the line safe; they open no port until `close`."""

    def __init__(self, line: Line, report: Report) -> None:
        urls = [station.url for station in line.stations]
        self._asked = [Inquiry(folder) for folder in open_leases.unclosed(None, urls)]
        for folder in (asked.folder for asked in self._asked if asked.is_at_work):
            report(f"the guard of the run {folder} is at work on this line; it tries again first")
        self._reports = [
            (asked.folder, unsafe) for asked in self._asked for unsafe in asked.answer()
        ]

    def report(self, url: str) -> tuple[Path, Unsafe] | None:
        """Return the run, and what its guard could not make safe at this port."""
        return next((report for report in self._reports if report[1].is_at(url)), None)

    def close(self) -> None:
        """Let the guards continue."""
        for asked in self._asked:
            asked.close()


# -- runs that hold the line -----------------------------------------------------------------------


def end_runs(line: Line, report: Report) -> list[EndedRun]:
    """End the runs that hold the line's ports; `report` gets each step."""
    urls = [station.url for station in line.stations]
    recorders = [(folder, _Recorder(folder)) for folder in runs_that_hold(urls)]
    for folder, recorder in recorders:
        report(f"the run {folder} holds this line; it is ended with SIGTERM{_since(folder)}")
        recorder.send(signal.SIGTERM)
    end = time.monotonic() + TERM_S
    return [
        EndedRun(folder, _end(folder, recorder, urls, end, report))
        for folder, recorder in recorders
    ]


def _since(folder: Path) -> str:
    from jbclog.record.manifest import read_manifest

    try:
        begun = read_manifest(folder).t0_utc
    except RecordError:
        return ""
    if begun is None:
        return ""
    moment = datetime.fromtimestamp(begun, UTC)
    return f" (it records since {moment:%Y-%m-%d %H:%M:%S} UTC)"


def _end(
    folder: Path, recorder: _Recorder, urls: Collection[str], end: float, report: Report
) -> HowEnded:
    if _releases_ports(folder, recorder, urls, end - time.monotonic()):
        how = HowEnded.ASKED
    else:
        report(f"the run {folder} still holds the line after {TERM_S:g} s; it is killed")
        recorder.send(signal.SIGKILL)
        how = HowEnded.KILLED if recorder.is_gone_within(KILLED_S) else HowEnded.REFUSED
    if recorder.is_gone_within(0.0):
        with suppress(RecordError):  # reported with each station that it still holds
            await_guard(folder, GUARD_S)
    return how


def _releases_ports(
    folder: Path, recorder: _Recorder, urls: Collection[str], seconds: float
) -> bool:
    """Return whether the run releases its ports or ends within `seconds`; sealing takes longer."""
    end = time.monotonic() + seconds
    while not recorder.is_gone_within(LOOK_S):
        if not holds(folder, urls):
            return True
        if time.monotonic() > end:
            return False
    return True


class _Recorder:
    """The process that records the run in `folder`, by a descriptor, because its id may be
    reused.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._pid = recorder_of(folder)
        self._descriptor: int | None = None
        if self._pid is not None:
            with suppress(AttributeError, OSError):
                self._descriptor = os.pidfd_open(self._pid)
            if recorder_of(folder) != self._pid:  # it ended before it was opened
                self._pid = self._descriptor = None

    def send(self, number: signal.Signals) -> None:
        # it has ended, or belongs to another user: the holders of the ports show it
        with suppress(OSError):
            if self._descriptor is not None:
                signal.pidfd_send_signal(self._descriptor, number)
            elif self._pid is not None and recorder_of(self._folder) == self._pid:
                os.kill(self._pid, number)

    def is_gone_within(self, seconds: float) -> bool:
        if self._descriptor is None:
            time.sleep(seconds)
            return self._pid is None or recorder_of(self._folder) != self._pid
        watched = select.poll()
        watched.register(self._descriptor, select.POLLIN)
        return bool(watched.poll(seconds * 1000))
