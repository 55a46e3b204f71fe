"""Leases that nobody closed: recorder and guard both died, the host lost its power. The next start deals with them first."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from jbclog.errors import RecordError
from jbclog.guard import lease
from jbclog.guard.diary import Diary
from jbclog.guard.lease import StationLease
from jbclog.guard.only_one import only_one
from jbclog.guard.takeover import CRITICAL, ERROR, take_over

PATIENCE_S: Final = 6.0  # a guard that is just taking over has done by then


def settle(out: Path, urls: Collection[str]) -> list[str]:
    """Make safe what runs below `out` left hot on the ports `urls`; a sentence for each run that left anything.

    A run that goes on holds its ports itself, and is left alone.
    """
    return [text for folder in _unclosed(out, urls) if (text := _settle(folder, urls)) is not None]


def _unclosed(out: Path, urls: Collection[str]) -> Iterator[Path]:
    for path in sorted(out.glob(f"*/{lease.NAME}")) if out.is_dir() else []:
        if any(station.url in urls for station in lease.kept(path.parent)):
            yield path.parent


def _settle(folder: Path, urls: Collection[str]) -> str | None:
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            with only_one(folder):
                return _take_over(folder, urls)
        except RecordError:  # its guard is there: either the run goes on, or it is being made safe now
            if time.monotonic() > end:
                return None
            time.sleep(0.1)


def _take_over(folder: Path, urls: Collection[str]) -> str | None:
    held = lease.kept(folder)
    ours = [station for station in held if station.url in urls]
    if not ours:  # the guard that was there has done it meanwhile
        return None
    diary = Diary(folder)
    left = take_over(ours, diary)
    others = [station for station in held if station.url not in urls]
    lease.keep(folder, [*others, *left])
    done = "not every tool could be made safe" if left else "every tool is in its safe state now"
    text = f"Run {folder.name} had left tools of {_names(ours)} as they were: {done}."
    diary.write("guard.left_over", CRITICAL if left else ERROR, text)
    return text


def _names(stations: list[StationLease]) -> str:
    return ", ".join(station.name for station in stations)
