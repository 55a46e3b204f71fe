"""Leases left open because recorder and guard both died, or the host lost power. The next start
settles them first.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from jbclog.core.errors import RecordError
from jbclog.guard import lease
from jbclog.guard.action_log import ActionLog
from jbclog.guard.lease import Leases, StationLease, guard_lock
from jbclog.guard.takeover import CRITICAL, ERROR, INFO, TakeOver

PATIENCE_S: Final = 6.0  # a working guard ends within this
RETRY_S: Final = 0.1
# for all runs together: a start waits for it, and a dozen wrong leases take half a minute
SETTLE_S: Final = 12.0

IsRecording = Callable[[Path], bool]
"""Returns True if a recorder writes to the run in this folder now."""


class LeftOver(NamedTuple):
    """The result for a run that left tools hot."""

    is_safe: bool
    text: str


def settle(out: Path, urls: Collection[str], is_recording: IsRecording) -> list[LeftOver]:
    """Make safe what this user's runs, and those below `out`, left hot on the ports `urls`, the
    newest first; skip runs in progress. After `SETTLE_S` no further run is begun: it is not known
    what that one left hot.
    """
    found, end = _with_lease(out), time.monotonic() + SETTLE_S
    settled = [
        _no_time(folder, is_recording)
        if time.monotonic() >= end
        else _settle(folder, urls, is_recording)
        for folder in _holding(sorted(found.there, key=_by_name, reverse=True), urls)
    ]
    return [
        *filter(None, settled),
        *_unreadable(found.there, is_recording),
        *(_not_known(folder, why) for folder, why in found.away),
    ]


def _unreadable(folders: Iterable[Path], is_recording: IsRecording) -> Iterator[LeftOver]:
    for folder in folders:
        why = lease.why_unreadable(folder)
        if why and not _goes_on(folder, is_recording):
            why = f"{folder / lease.NAME} cannot be read ({why})"
            yield _not_known(folder, why, ", then remove that file")


def _by_name(folder: Path) -> str:
    return folder.name  # begins with its run's start


def _no_time(folder: Path, is_recording: IsRecording) -> LeftOver | None:
    if _goes_on(folder, is_recording):
        return None
    return _not_known(folder, f"{folder / lease.NAME} had no turn within {SETTLE_S:.0f} s")


def _not_known(folder: Path, why: str, then: str = "") -> LeftOver:
    text = f"{why}: whether run {folder.name} left tools hot is not known."
    return LeftOver(False, f"{text} Make them safe with `jbclog safe`{then}.")


def _goes_on(folder: Path, is_recording: IsRecording) -> bool:
    """Whether a run is in progress. Where its lock may not be read, that of its guard decides."""
    with suppress(OSError):
        return is_recording(folder)
    return False


def unclosed(out: Path | None, urls: Collection[str]) -> Iterator[Path]:
    """Yield the folders with a lease on any of these ports: below `out`, and registered ones within
    reach.
    """
    return _holding(_with_lease(out).there, urls)


def _holding(folders: Iterable[Path], urls: Collection[str]) -> Iterator[Path]:
    for folder in folders:
        if any(_is_wanted(station, urls) for station in lease.read_leases(folder)):
            yield folder


def _with_lease(out: Path | None) -> Leases:
    below = Leases([], []) if out is None else lease.runs_below(out)
    registered = lease.registered_runs()
    return Leases(
        sorted({*below.there, *registered.there}), sorted({*below.away, *registered.away})
    )


def _is_wanted(station: StationLease, urls: Collection[str]) -> bool:
    return any(station.is_at(url) for url in urls)


def _settle(folder: Path, urls: Collection[str], is_recording: IsRecording) -> LeftOver | None:
    end = time.monotonic() + PATIENCE_S
    while not _goes_on(folder, is_recording):
        try:
            with guard_lock(folder):
                return _take_over(folder, urls)
        except RecordError:  # its guard is making it safe
            if time.monotonic() > end:
                break
            time.sleep(RETRY_S)
        except OSError as error:
            return LeftOver(
                False,
                f"Run {folder.name} left tools hot, and they could not be made safe: {error}.",
            )
    return None


def _take_over(folder: Path, urls: Collection[str]) -> LeftOver | None:
    held = lease.read_leases(folder)
    ours = [station for station in held if _is_wanted(station, urls)]
    if not ours:  # its guard has finished meanwhile
        return None
    action_log = ActionLog(folder, "jbclog run")
    left = TakeOver(ours, action_log, spare=True).run()
    if not action_log.is_torn:
        with suppress(OSError):
            lease.write_leases(
                folder, [*(station for station in held if station not in ours), *left]
            )
    text = _log_result(action_log, folder, ours, is_safe=not left)
    action_log.tidy()
    return LeftOver(not left, text)


def _log_result(
    action_log: ActionLog, folder: Path, stations: Collection[StationLease], *, is_safe: bool
) -> str:
    done = "every tool is in its safe state now" if is_safe else "not every tool could be made safe"
    text = (
        f"Run {folder.name} ended without making the tools of"
        f" {', '.join(sorted(one.name for one in stations))} safe; {done}."
    )
    action_log.write("guard.left_over", ERROR if is_safe else CRITICAL, text)
    return text


LIST_STEP: Final = "set XDG_STATE_HOME to a folder that this user can write"


def about_list(folder: Path) -> tuple[bool, str]:
    """Return whether the open leases of a run in `folder` can be listed, and what follows; empty if
    the state folder can be written.
    """
    found = lease.listing(folder)
    why = "; ".join(found.why_not)
    if found.registry is None:
        return False, (
            f"cannot be listed ({why}): if recorder and guard are both killed, only a run with the"
            " same --out makes the tools safe"
        )
    if found.is_lasting:
        return True, ""
    return True, f"are listed in {found.registry}, which a restart of the host empties ({why})"


class Seen(NamedTuple):
    """Read back from a station made safe by hand; None: a port without a tool."""

    model: str | None
    states: Mapping[int, str | None]
    feeder_stands: bool


def close(
    urls: Collection[str],
    look: Callable[[StationLease], Seen | None],
    is_recording: IsRecording,
    who: str,
    out: Path | None = None,
) -> list[Path]:
    """Close the leases on these ports, of this user's runs and those below `out`, as far as `look`
    confirms them safe; return the folders of their runs.
    """
    return [
        folder
        for folder in unclosed(out, urls)
        if not _goes_on(folder, is_recording) and _close(folder, look, who)
    ]


def _close(folder: Path, look: Callable[[StationLease], Seen | None], who: str) -> bool:
    """Return True if anything was closed; a guard at work closes its own leases."""
    with suppress(RecordError, OSError), guard_lock(folder):
        held, action_log = lease.read_leases(folder), ActionLog(folder, who)
        left = [_without(station, look(station), action_log) for station in held]
        closed = {
            before: after for before, after in zip(held, left, strict=True) if after != before
        }
        if closed:
            _log_result(
                action_log,
                folder,
                closed,
                is_safe=not any(after.holds for after in closed.values()),
            )
            if not action_log.is_torn:
                lease.write_leases(folder, left)
            action_log.tidy()
            return True
    return False


def note_orders(url: str, texts: Mapping[int, str], who: str) -> None:
    """Write down an order without an answer, by port, in the runs that left this station hot. Does
    not raise.
    """
    for folder in unclosed(None, [url]):
        with suppress(RecordError, OSError), guard_lock(folder):
            action_log = ActionLog(folder, who)
            for station in lease.read_leases(folder):
                for port in station.ports if station.is_at(url) else ():
                    if port in texts:
                        text = f"{who}: {texts[port]}."
                        action_log.write(
                            "safety.not_safe", CRITICAL, text, station.name, port, value=1
                        )
            action_log.tidy()


def _without(station: StationLease, seen: Seen | None, action_log: ActionLog) -> StationLease:
    """Return the lease without the tools seen safe."""
    if seen is None or seen.model != station.model:
        return station
    for port in station.ports:
        if port in seen.states:
            state = seen.states[port]
            text = (
                "The port no longer has a tool"
                if state is None
                else f"The tool was found safe, as read back: {state}"
            )
            action_log.write("safety.safe_state", INFO, f"{text}.", station.name, port)
    return replace(
        station,
        ports=tuple(port for port in station.ports if port not in seen.states),
        feeds=station.feeds and not seen.feeder_stands,
    )
