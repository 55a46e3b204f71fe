"""What the records of runs tell of errors since an audit last looked: the runs in the folder that `jbclog audit --runs` names.

An error that came and went between two audits only a run can have seen. Each look at a station says up to which moment errors
were counted (`Errors.until`), and the next one counts from there on: whatever runs there are meanwhile, one that goes on over
several audits among them, an event counts once. What a recorder has not put down yet counts the next time (`LAG`).
"""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jbclog.core.errors import JbclogError, RecordError
from jbclog.maintenance.counter_totals.observed import Observation
from jbclog.record.find_runs import Filter, Found, Unreadable, find

if TYPE_CHECKING:
    from jbclog.analysis.run import Run

LAG: Final = timedelta(seconds=10)  # a recorder commits each second, and waits that long for a disk at the most
COUNTED: Final = ("error", "critical")  # severities of events
MOST_TOLD: Final = 3

Place = tuple[str, str]
"""Line and station."""
Events = Mapping[str, int]
"""How many of each kind."""


@dataclass(slots=True)
class PastRuns:
    """What the runs of a folder tell of each station up to `until`. `trouble` says what of them cannot be read."""

    until: str = ""
    events: dict[Place, Counter[str]] = field(default_factory=dict)
    since: Mapping[Place, str] = field(default_factory=dict)
    folders: set[Path] = field(default_factory=set)
    is_read: bool = True
    trouble: list[str] = field(default_factory=list)

    def with_errors(self, seen: Observation) -> Observation:
        """What was seen of a station, with the errors that these runs saw; those of a run that is none of them are added."""
        place = (seen.line, seen.station)
        if not seen.seen or place not in self.since:
            return seen
        errors, told = seen.errors, self.events.get(place)
        if not self.is_read:  # the next audit counts from where this one should have
            return replace(seen, errors=replace(errors, events=None, until=self.since[place]))
        if errors.events is not None and Path(os.path.realpath(seen.source.removeprefix("run:"))) not in self.folders:
            told = Counter(errors.events) + (told or Counter())
        until = max(self.until, self.since[place], key=datetime.fromisoformat)
        return replace(seen, errors=replace(errors, events=None if told is None else dict(told), until=until))


def counted_to(audit: str) -> str:
    """Up to when the audit that began then counts."""
    return (datetime.fromisoformat(audit) - LAG).astimezone(UTC).isoformat(timespec="milliseconds")


def past_runs(folder: Path, since: Mapping[Place, str], audit: str) -> PastRuns:
    """The errors of each station of `since` from its moment on, in the runs directly below `folder`. Never raises."""
    told = PastRuns(counted_to(audit), since=since)
    try:
        if not folder.is_dir():
            raise RecordError(f"{folder}: there is no such folder of runs")
        for run in _runs(folder, since, told):
            _count(run, told)
    except RecordError as error:
        told.trouble.append(f"{error}; errors since last time were not counted, and will be by the next audit")
        told.is_read = False
    return told


def _runs(folder: Path, since: Mapping[Place, str], told: PastRuns) -> Iterator[Found]:
    """Those with one of these stations, that had not ended before."""
    if not since:
        return
    begin = min(map(datetime.fromisoformat, since.values()))
    unreadable = []
    for run in find(folder, Filter(ended_since=begin)):
        if isinstance(run, Unreadable):
            unreadable.append(run)
        elif any((run.line, station) in since for station in run.stations):
            yield run
    told.trouble += [f"{one.folder}: {one.why}" for one in unreadable[:MOST_TOLD]]
    if len(unreadable) > MOST_TOLD:
        told.trouble.append(f"{folder}: {len(unreadable) - MOST_TOLD} other runs cannot be read")


def _count(found: Found, told: PastRuns) -> None:
    from jbclog.analysis.run import open_run

    places = [(found.line or "", station) for station in found.stations]
    try:
        run = open_run(found.folder)
        counted = {
            place: error_events(run, place[1], told.since[place], told.until)
            for place in places
            if place in told.since and _is_within(found, told.since[place], told.until)
        }
    except (JbclogError, OSError, ValueError) as error:
        told.trouble.append(f"{found.folder}: its errors cannot be read: {error}")
        return
    told.folders.add(Path(os.path.realpath(found.folder)))
    for place, events in counted.items():
        told.events.setdefault(place, Counter()).update(events)


def _is_within(found: Found, since: str, until: str) -> bool:
    began = found.started is None or datetime.fromisoformat(found.started) < datetime.fromisoformat(until)
    ended = found.ended is not None and datetime.fromisoformat(found.ended) < datetime.fromisoformat(since)
    return began and not ended


def error_events(run: Run, station: str, since: str | None, until: str) -> Events:
    """How many errors of each kind a run's record has of a station, from `since` (included) to `until`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # damage to a record is told by `check`
        events = run.events(station, start=since, stop=until)
    counted = events[events["severity"].isin(COUNTED)]["kind"].value_counts()
    return {str(kind): int(count) for kind, count in sorted(counted.items())}
