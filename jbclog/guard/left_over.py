"""Leases that nobody closed: recorder and guard both died, the host lost its power. The next start deals with them first."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from jbclog.errors import RecordError
from jbclog.guard import lease
from jbclog.guard.diary import Diary
from jbclog.guard.lease import StationLease
from jbclog.guard.only_one import only_one
from jbclog.guard.takeover import CRITICAL, ERROR, TakeOver

PATIENCE_S: Final = 6.0  # a guard that is just taking over has done by then
AGAIN_S: Final = 0.1

IsRecording = Callable[[Path], bool]
"""Whether a recorder writes to the run in this folder now."""


class LeftOver(NamedTuple):
    """What was done about a run that had left tools as they were."""

    is_safe: bool
    text: str


def settle(out: Path, urls: Collection[str], is_recording: IsRecording) -> list[LeftOver]:
    """Make safe what runs below `out` left hot on the ports `urls`. A run that goes on holds its ports itself."""
    return [done for folder in _unclosed(out, urls) if (done := _settle(folder, urls, is_recording)) is not None]


def _unclosed(out: Path, urls: Collection[str]) -> Iterator[Path]:
    for path in sorted(out.glob(f"*/{lease.NAME}")) if out.is_dir() else []:
        if any(_is_wanted(station, urls) for station in lease.kept(path.parent)):
            yield path.parent


def _is_wanted(station: StationLease, urls: Collection[str]) -> bool:
    return any(station.is_at(url) for url in urls)


def _settle(folder: Path, urls: Collection[str], is_recording: IsRecording) -> LeftOver | None:
    end = time.monotonic() + PATIENCE_S
    while not is_recording(folder):
        try:
            with only_one(folder):
                return _take_over(folder, urls)
        except RecordError:  # its guard is there, and makes it safe now
            if time.monotonic() > end:
                break
            time.sleep(AGAIN_S)
        except OSError as error:
            return LeftOver(False, f"Run {folder.name} left tools hot, and nothing could be done about it: {error}.")
    return None


def _take_over(folder: Path, urls: Collection[str]) -> LeftOver | None:
    held = lease.kept(folder)
    ours = [station for station in held if _is_wanted(station, urls)]
    if not ours:  # the guard that was there has done it meanwhile
        return None
    diary = Diary(folder)
    left = TakeOver(ours, diary, spare=True).run()
    with suppress(OSError):
        lease.keep(folder, [*(station for station in held if station not in ours), *left])
    done = "not every tool could be made safe" if left else "every tool is in its safe state now"
    names = ", ".join(sorted(station.name for station in ours))
    text = f"Run {folder.name} had left tools of {names} as they were: {done}."
    diary.write("guard.left_over", CRITICAL if left else ERROR, text)
    return LeftOver(not left, text)
