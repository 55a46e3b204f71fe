"""Runs that used a tip which failed its verification.

*Bad* is the last failed verification of the given station, port and tip. *Suspect* is every run
between the last pass before it (or the beginning) and the next pass after it, because the tip may
have failed at any time in between. A run is suspect for the ports that it recorded, except a port
for which it names another tip.

Unreadable runs are listed separately: they may be suspect, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from jbclog.core.errors import RecordError, UsageError
from jbclog.maintenance.verification import Book, Result, Verification, read_book
from jbclog.record.find_runs import Found, Unreadable, find, summary_of
from jbclog.record.manifest import read_manifest

Search = Callable[[Path], Iterable[Found | Unreadable]]
"""Finds the runs below a folder."""


@dataclass(frozen=True, slots=True)
class Used:
    """A run that used a tip of the station, its ports and the tip named for each (or None)."""

    folder: Path
    start: str | None
    stop: str | None
    ports: tuple[int, ...]
    tips: tuple[str | None, ...]
    units: tuple[str, ...]
    order: str | None
    verdict: str | None


@dataclass(frozen=True, slots=True)
class Suspect:
    """The runs in the window from `since` to `until` (None: open), and the reason for the window.
    `bad` is None if none failed.
    """

    bad: Verification | None
    since: datetime | None
    until: datetime | None
    why: str
    runs: list[Used] = field(default_factory=list)
    unreadable: list[Unreadable] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)


def where_used(
    out: Path,
    station: str,
    port: int | None = None,
    tip: str | None = None,
    since: datetime | None = None,
    search: Search = find,
    verifications: Path | None = None,
) -> Suspect:
    """Return the runs below `out` that used a tip of `station` since the last passed verification,
    or since `since`.

    `search` finds the runs; the manifest of each run found is read and hashed again.
    `verifications`: the folder of the file of verifications, if not `out`.

    Raises `RecordError` if the folder or the file of verifications cannot be read, `UsageError` for
    an unknown station, because a mistyped name would have no suspect runs.
    """
    book = read_book(verifications or out)
    _expect_known(search(out), out, book, station)
    window = _window(book, station, port, tip, since)
    if window.bad is None and since is None:
        window.unreadable.extend(one for one in search(out) if isinstance(one, Unreadable))
        return window
    if tip is None and window.bad is not None and since is None:
        tip = window.bad.tip
    for found in search(out):  # without a filter, because an unreadable run may be suspect
        try:
            is_named = isinstance(found, Found) and _is_suspect(found, station, window)
            run = summary_of(found.folder) if isinstance(found, Found) and is_named else found
            if isinstance(run, Unreadable):
                window.unreadable.append(Unreadable(found.folder, run.why))
            elif run is not None and _is_suspect(run, station, window):
                window.runs.extend(_used(run, station, port, tip))
        except RecordError as error:
            window.unreadable.append(Unreadable(found.folder, str(error)))
    return window


def _is_suspect(run: Found, station: str, window: Suspect) -> bool:
    return station in run.stations and _was_on(run, window)


def _expect_known(runs: Iterable[Found | Unreadable], out: Path, book: Book, station: str) -> None:
    names: set[str] = {one.station for one in book.entries}
    if station in names or book.wrong:
        return
    for run in runs:
        if isinstance(run, Unreadable) or station in run.stations:
            return  # an unreadable run may be of this station
        names.update(run.stations)
    known = f"known stations: {', '.join(sorted(names))}" if names else "no station is known yet"
    raise UsageError(
        f"{station}: no run in {out} and no verification has a station of that name; {known}"
    )


def _window(
    book: Book, station: str, port: int | None, tip: str | None, since: datetime | None
) -> Suspect:
    these = [
        one
        for one in book.entries
        if one.station == station
        and one.is_valid
        and port in (None, one.port)
        and tip in (None, one.tip)
    ]
    bad = next((one for one in reversed(these) if one.result == Result.FAIL), None)
    if since is not None:
        return Suspect(bad, since, None, "Runs since the given time.", wrong=book.wrong)
    if bad is None:
        why = (
            "No verification failed; give --since to list runs since a time."
            if these
            else "No verification is known."
        )
        return Suspect(None, None, None, why, wrong=book.wrong)
    same = [
        one
        for one in these
        if (one.port, one.tip) == (bad.port, bad.tip) and one.result == Result.PASS
    ]
    good = next((one for one in reversed(same) if one.seq < bad.seq), None)
    again = next((one for one in same if one.seq > bad.seq), None)
    why = f"Tip {bad.tip} in port {bad.port} failed at {bad.time[:16]}Z ({bad.offset_c:+.1f} °C)"
    why += f"; last pass at {good.time[:16]}Z" if good else "; it had never passed before"
    why += f", next pass at {again.time[:16]}Z." if again else ", not passed since."
    return Suspect(bad, _moment(good), _moment(again), why, wrong=book.wrong)


def _moment(one: Verification | None) -> datetime | None:
    return None if one is None else datetime.fromisoformat(one.time)


def _was_on(run: Found, window: Suspect) -> bool:
    """Whether the run and the window overlap; a run without an end is taken to continue."""
    began = None if run.host_start is None else datetime.fromisoformat(run.host_start)
    ended = None if run.host_stop is None else datetime.fromisoformat(run.host_stop)
    is_before = window.since is not None and ended is not None and ended < window.since
    is_after = window.until is not None and began is not None and began > window.until
    return not (is_before or is_after)


def _used(run: Found, station: str, port: int | None, tip: str | None) -> Iterator[Used]:
    manifest = read_manifest(run.folder)
    facts = manifest.station(station)
    if facts is None:
        return
    ports = [number for number in facts.ports or [port or 1] if port in (None, number)]
    named = {number: manifest.metadata.tip(station, number) for number in ports}
    these = [number for number in ports if tip is None or named[number] in (None, tip)]
    if these:
        tips = tuple(named[number] for number in these)
        yield Used(
            run.folder,
            run.start,
            run.stop,
            tuple(these),
            tips,
            run.units,
            run.order,
            run.verdict,
        )
