"""A recorded run lived through once more, without any port and as fast as the machine can, and held against the first time.

Each session is told what it was told then (`drive.told`) and so does the same, and the tables come out the same, to the
microsecond. Where the program is not the same any more and asks something else, its session goes on with the tape as its
station (`sim.tape`) on a virtual clock.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from math import inf
from pathlib import Path

from jbclog.app.replay.recording import Recording, plan_of
from jbclog.app.run.run_record import Observer, Result, RunRecord
from jbclog.core.clock import VirtualClock
from jbclog.core.io_requests import Steps
from jbclog.core.rows import NoJournal
from jbclog.core.wire import Row
from jbclog.record.compare import Compared, Comparison, compare_records
from jbclog.record.manifest import Lost
from jbclog.record.schema import TABLES
from jbclog.session.run.context import SessionContext
from jbclog.session.run.station_run import run_station
from jbclog.sim.replayed_station import TapeStation
from jbclog.sim.virtual import Reply
from jbclog.transport.session_history import ENDS, Astray, reliving, steps_of
from jbclog.transport.virtual import VirtualDriver

GRACE_S = 5.0  # that a session which left its tape may still take once the tape is over


@dataclass(frozen=True, slots=True)
class Again:
    """What living through a run once more came to, and which sessions left their tapes where."""

    result: Result
    left: Mapping[str, Astray]

    @property
    def cut_off(self) -> list[str]:
        """The stations whose recordings ended before their sessions did."""
        return [name for name, astray in self.left.items() if astray.is_cut_off]


def record_again(recording: Recording, out: Path, observer: Observer) -> Again:
    """Live through the run and record that below `out`. Raises `RecordError` where it cannot be kept, or the tape be read."""
    clock = VirtualClock(recording.first.t0_mono, recording.first.t0_utc)
    run_record = RunRecord(plan_of(recording), out, observer, clock)
    run_record.begin()
    left = relive(recording, run_record.contexts, clock)
    cut_off = [name for name, astray in left.items() if astray.is_cut_off]
    lost = f"The recording of {', '.join(cut_off)} ends before its run did." if cut_off else None
    run_record.manifest.lost = Lost(None, lost) if lost else None
    return Again(run_record.conclude(run_record.close() or lost), left)


# -- held against the first time ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Held:
    """The two lives of a run held against each other. `was_cut`: of the first, too, the end is not known."""

    comparison: Comparison
    was_cut: bool
    left: tuple[str, ...]  # stations that left their tapes, which did not end there

    @property
    def counts(self) -> dict[str, tuple[int, int]]:
        """By table: of how many recorded rows how many were compared, as (compared, recorded)."""
        return {table: self.comparison.share(table) for table in TABLES}

    @property
    def compared(self) -> str:
        """How many rows of which tables were held against each other."""
        shares = (f"{compared} of {recorded} rows of {table}" for table, (compared, recorded) in self.counts.items())
        return f"compared: {', '.join(shares)}"

    @property
    def lacking(self) -> list[str]:
        """Of what less could be compared than was recorded."""
        return self.comparison.lacking if self.comparison.is_cut else []

    @property
    def uncompared(self) -> list[str]:
        """What makes this no proof: tables that nothing was held against, and wires that kept less than their run."""
        if not self.comparison.rows:
            return ["nothing was compared: no row was decoded from what the wires kept"]
        if not self.was_cut:
            return self.lacking
        return [f"{one.table}, {one.station}: none of {one.first} rows could be compared" for one in self._unheld()]

    def _unheld(self) -> Iterator[Compared]:
        return (one for one in self.comparison.tables if one.table == "samples" and one.first and not one.rows)

    @property
    def is_same(self) -> bool:
        """Whether all that was recorded came out once more; of a run that was itself cut off, all that its wires kept."""
        return not (self.comparison.differences or self.uncompared or self.left)


def compare(recording: Recording, again: Again) -> Held | None:
    """How the two lives compare; None where the recorded run is not sealed and so has no tables yet."""
    manifest = recording.manifest
    if manifest is None or manifest.state != "sealed":
        return None
    was_cut = manifest.lost is not None and not recording.is_damaged
    unkept = [one.name for one in manifest.stations if one.name not in recording.heads]
    is_cut = manifest.lost is not None or bool(again.cut_off) or bool(unkept)
    comparison = compare_records(recording.folder, again.result.folder, is_cut=is_cut)
    return Held(comparison, was_cut, tuple(name for name in again.left if name not in again.cut_off))


# -- the second life -----------------------------------------------------------------------------------------------------------


def relive(recording: Recording, contexts: Iterable[SessionContext], clock: VirtualClock) -> dict[str, Astray]:
    """Run the sessions of `contexts` on what was recorded; give where they left it, by station, if they did."""
    driver = VirtualDriver(clock)
    lives = [_Life(recording, context) for context in contexts]
    for life in lives:
        driver.add(life.steps(), life)
    driver.run()
    return {life.name: life.astray for life in lives if life.astray is not None}


class _Life:
    """The second life of one session, and the station that it needs only where it leaves its tape."""

    def __init__(self, recording: Recording, context: SessionContext) -> None:
        self.name = context.name
        self.astray: Astray | None = None
        self._context = context
        self._tape = partial(recording.tape, context.name)
        self._ticks = recording.ticks(context.name)
        self._station: TapeStation | None = None

    def steps(self) -> Steps[object]:
        return reliving(run_station(self._context), steps_of(self._tape()), self._left)

    def receive(self, data: bytes, now: float) -> list[Reply]:
        return self._station.receive(data, now) if self._station else []

    def hung_up(self, now: float) -> bool:
        return self._station is not None and self._station.hung_up(now)

    def _left(self, astray: Astray) -> tuple[float, str]:
        self.astray = astray
        if astray.step is None:
            self._context.journal = NoJournal()  # what a session does that is given up was not recorded
            return inf, ""
        rest = partial(self._tape, astray.step.place)
        self._station = TapeStation(self.name, rest, ticks=self._ticks)
        return _end(rest())


def _end(rows: Iterable[Row]) -> tuple[float, str]:
    """When and why a session was ended then; at the latest some seconds after its tape."""
    at_s = 0.0
    for row in rows:
        at_s = row.at_s
        if row.what in ENDS:
            return at_s, row.text
    return at_s + GRACE_S, "the recording is over"
