"""Replays a recorded run: reproduced from its captures without ports, or served."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from pathlib import Path

from jbclog.app.run.options import Metadata, RunOptions
from jbclog.app.run.plan import Plan, StationPlan, station_plan
from jbclog.app.run.run_record import Observer, Result, RunRecord
from jbclog.config.line import Line, Replay, StationSpec, load_line
from jbclog.config.load_recipe import load_recipe
from jbclog.core.capture_rows import CaptureRow, ResultRow
from jbclog.core.clock import VirtualClock
from jbclog.core.errors import UsageError
from jbclog.core.io_requests import Steps
from jbclog.core.rows import TABLES, NoJournal, StationFacts
from jbclog.record import sealed_files
from jbclog.record.capture import Head, read_exchanges, read_to_hole, wire_path, wire_paths
from jbclog.record.compare import Compared, Comparison, compare_records
from jbclog.record.folder import recipe_copy
from jbclog.record.manifest import NAME, Lost, Manifest, read_manifest
from jbclog.session.rates import AS_FAST_AS_POSSIBLE
from jbclog.session.run.context import SessionContext
from jbclog.session.run.station_run import run_station
from jbclog.sim.recorded_exchanges import RecordedGrid
from jbclog.sim.replayed_station import ReplayedStation
from jbclog.sim.serve import Server
from jbclog.sim.setup import Tcp, set_up
from jbclog.sim.virtual import Reply
from jbclog.transport.session_history import ERROR_OF_RESULT, Divergence, replay_steps, replayed
from jbclog.transport.virtual import VirtualDriver

# -- recording -------------------------------------------------------------------------------------

REPLAY_OF = "replay_of"  # tag with the name of the recorded run


@dataclass(frozen=True, slots=True)
class Recording:
    """A run with serial captures: its folder, its line, and the header of each capture."""

    folder: Path
    line: Line
    heads: Mapping[str, Head]

    @property
    def stations(self) -> list[StationSpec]:
        """The captured stations in the line's order, as their sessions had them."""
        named = [spec for spec in self.line.stations if spec.name in self.heads]
        return [spec.model_copy(update={"url": self.heads[spec.name].url}) for spec in named]

    @property
    def first(self) -> Head:
        """A header; the settings of the run are the same in all of them."""
        return next(iter(self.heads.values()))

    def recipe_path(self, station: str) -> Path:
        return recipe_copy(self.folder, self.heads[station].recipe)

    def ticks(self, station: str) -> RecordedGrid | None:
        """Return a station's sampling grid on the recorder's clock; None if not known."""
        facts = self.facts.get(station)
        if (
            facts is None
            or facts.first_tick is None
            or facts.period_s is None
            or self.line.replay is not None
        ):
            return None
        return RecordedGrid(
            self.heads[station].t0_mono + facts.first_tick * facts.period_s, facts.period_s
        )

    @property
    def facts(self) -> Mapping[str, StationFacts]:
        """Facts of the stations in the manifest, by name."""
        return {one.name: one for one in self.manifest.stations} if self.manifest else {}

    @property
    def replay(self) -> Replay:
        """Settings to record the run again: its rates, on grids with the same offsets."""
        known = [name for name in self.heads if self.ticks(name) is not None]
        first_tick = {name: self.facts[name].first_tick or 0 for name in known}
        return Replay(
            rate_hz=self.rates_hz,
            first_tick=first_tick,
            first_in_s={name: self._first_in_s(name) for name in known},
        )

    def _first_in_s(self, station: str) -> float:
        """Return the time between the last message to its session before the first tick and that
        tick.
        """
        ticks, last_s = self.ticks(station), 0.0
        assert ticks is not None
        for row in self.tape(station):
            if row.at_s >= ticks.first_s:
                break
            last_s = row.at_s if isinstance(row, ResultRow) and row.what == "told" else last_s
        return ticks.first_s - last_s

    def tape(self, station: str, first: int = 0) -> Iterator[CaptureRow]:
        """Return the rows of a station's capture from number `first` on, up to the first gap."""
        return read_to_hole(wire_path(self.folder, station), first)

    def exchanges(self, station: str) -> Iterator[CaptureRow]:
        """Return the rows of a station's capture up to the last read with a result."""
        return read_exchanges(wire_path(self.folder, station))

    @property
    def doubts(self) -> list[str]:
        """Missing or changed parts of the recording, a sentence each. Raises `RecordError`."""
        return sealed_files.doubts(self.folder, self.manifest)

    @property
    def manifest(self) -> Manifest | None:
        """Manifest of the run, or None."""
        return read_manifest(self.folder) if (self.folder / NAME).exists() else None

    @property
    def is_damaged(self) -> bool:
        """Whether a part is missing or changed. Raises `RecordError`."""
        return bool(self.doubts)

    @property
    def is_paced(self) -> bool:
        """Whether it was sampled on a grid, and not as fast as possible."""
        return self.first.rate != AS_FAST_AS_POSSIBLE

    @property
    def rates_hz(self) -> dict[str, float]:
        """Station -> resulting rate, if known."""
        return {
            name: round(1 / one.period_s, 9)
            for name, one in self.facts.items()
            if one.period_s and self.is_paced
        }

    @property
    def sampled_s(self) -> float | None:
        """How long the run sampled on its grid: the requested duration, or until it was ended. None
        if unknown.
        """
        if self.first.duration_s is not None:
            return self.first.duration_s
        facts = self.manifest.stations if self.manifest else []
        spans = [_sampled_s(one) for one in facts]
        return max((span for span in spans if span is not None), default=None)

    @property
    def metadata(self) -> Metadata:
        """Metadata of the run, with a tag for the replay."""
        tags = {REPLAY_OF: Path(os.path.realpath(self.folder)).name}
        if self.manifest is None:
            return Metadata(tags=tags)
        kept = self.manifest.metadata
        lots = tuple(kept.wire_lots), tuple(kept.flux_lots)
        return Metadata(
            kept.operator,
            kept.order,
            kept.product,
            tuple(kept.units),
            kept.tags | tags,
            *lots,
            tuple(kept.tips),
        )


def _sampled_s(facts: StationFacts) -> float | None:
    if facts.first_tick is None or facts.last_tick is None or facts.period_s is None:
        return None
    return (facts.last_tick - facts.first_tick + 1) * facts.period_s


def open_recording(folder: Path) -> Recording:
    """Return the recording in a run's folder.

    Raises `UsageError` without a capture, `RecordError` if none is readable.
    """
    paths = wire_paths(folder)
    if not paths:
        raise UsageError(
            f"{folder}: has no serial capture; only a run recorded with --capture can be replayed"
        )
    heads = {head.station: head for head in sealed_files.readable_heads(paths)}
    return Recording(folder, load_line(folder / "line.toml"), heads)


def plan_of(recording: Recording) -> Plan:
    """Return the plan of the recorded run. Raises `Problems` if line file or recipe are no longer
    valid.
    """
    head = recording.first
    wanted = RunOptions(
        recording.line.path,
        stations=tuple(recording.heads),
        duration_s=head.duration_s,
        rate=head.rate,
        metadata=recording.metadata,
        guard=False,
        allow_omega_write=head.allow_omega_write,
        allow_missing=head.allow_missing,
    )
    stations = (_station_plan(recording, spec, wanted) for spec in recording.stations)
    return Plan(recording.line, tuple(stations), wanted)


def _station_plan(recording: Recording, spec: StationSpec, wanted: RunOptions) -> StationPlan:
    """Return the plan of a station; stations of a replayed run may have their own rates."""
    recipe = load_recipe(recording.recipe_path(spec.name), links=False)
    return station_plan(spec, recipe, replace(wanted, rate=recording.heads[spec.name].rate))


# -- reproduce -------------------------------------------------------------------------------------
# Each session gets the recorded results of its requests (`transport.session_history`), so it sends
# the same and the tables are the same, to the microsecond. If a later program sends something else,
# its session continues with the capture as its station (`sim.replayed_station`) on a virtual clock.

GRACE_S = 5.0  # for a diverged session after the end of its capture


@dataclass(frozen=True, slots=True)
class Again:
    """Result of reproducing a run, and where sessions diverged from their captures."""

    result: Result
    left: Mapping[str, Divergence]

    @property
    def cut_off(self) -> list[str]:
        """Stations whose captures ended before their sessions did."""
        return [name for name, astray in self.left.items() if astray.is_cut_off]


def record_again(recording: Recording, out: Path, observer: Observer) -> Again:
    """Reproduce the run and record it below `out`.

    Raises `RecordError` if that fails or a capture cannot be read.
    """
    clock = VirtualClock(recording.first.t0_mono, recording.first.t0_utc)
    run_record = RunRecord(plan_of(recording), out, observer, clock)
    run_record.begin()
    left = reproduce(recording, run_record.contexts, clock)
    cut_off = [name for name, astray in left.items() if astray.is_cut_off]
    lost = f"The recording of {', '.join(cut_off)} ends before its run did." if cut_off else None
    run_record.manifest.lost = Lost(None, lost) if lost else None
    return Again(run_record.conclude(run_record.close() or lost), left)


# -- comparison ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Held:
    """Comparison of a run with its reproduction. `was_cut`: the end of the run is not known
    either.
    """

    comparison: Comparison
    was_cut: bool
    left: tuple[str, ...]  # stations that diverged before their captures ended

    @property
    def counts(self) -> dict[str, tuple[int, int]]:
        """Table -> compared and recorded rows."""
        return {table: self.comparison.share(table) for table in TABLES}

    @property
    def compared(self) -> str:
        """Number of compared rows by table, as text."""
        shares = (
            f"{compared} of {recorded} rows of {table}"
            for table, (compared, recorded) in self.counts.items()
        )
        return f"compared: {', '.join(shares)}"

    @property
    def lacking(self) -> list[str]:
        """Tables with fewer rows compared than recorded."""
        return self.comparison.lacking if self.comparison.is_cut else []

    @property
    def uncompared(self) -> list[str]:
        """Why this is no proof: tables that were not compared, captures shorter than their run."""
        if not self.comparison.rows:
            return ["nothing was compared: no row was decoded from the captures"]
        if not self.was_cut:
            return self.lacking
        return [
            f"{one.table}, {one.station}: none of {one.first} rows could be compared"
            for one in self._uncompared()
        ]

    def _uncompared(self) -> Iterator[Compared]:
        return (
            one
            for one in self.comparison.tables
            if one.table == "samples" and one.first and not one.rows
        )

    @property
    def is_same(self) -> bool:
        """Whether everything recorded was reproduced; for a run that was cut off, everything in its
        captures.
        """
        return not (self.comparison.differences or self.uncompared or self.left)


def compare(recording: Recording, again: Again) -> Held | None:
    """Compare a run with its reproduction; None if the run is not sealed and has no tables yet."""
    manifest = recording.manifest
    if manifest is None or not manifest.is_sealed:
        return None
    was_cut = manifest.lost is not None and not recording.is_damaged
    unkept = [one.name for one in manifest.stations if one.name not in recording.heads]
    is_cut = manifest.lost is not None or bool(again.cut_off) or bool(unkept)
    comparison = compare_records(recording.folder, again.result.folder, is_cut=is_cut)
    return Held(
        comparison, was_cut, tuple(name for name in again.left if name not in again.cut_off)
    )


# -- sessions --------------------------------------------------------------------------------------


def reproduce(
    recording: Recording, contexts: Iterable[SessionContext], clock: VirtualClock
) -> dict[str, Divergence]:
    """Run the sessions of `contexts` on their captures; return where they diverged, by station."""
    driver = VirtualDriver(clock)
    sessions = [_ReplayedSession(recording, context) for context in contexts]
    for session in sessions:
        driver.add(session.steps(), session)
    driver.run()
    return {session.name: session.astray for session in sessions if session.astray is not None}


class _ReplayedSession:
    """One session on its capture, and the station for the part after a divergence."""

    def __init__(self, recording: Recording, context: SessionContext) -> None:
        self.name = context.name
        self.astray: Divergence | None = None
        self._context = context
        self._tape = partial(recording.tape, context.name)
        self._ticks = recording.ticks(context.name)
        self._station: ReplayedStation | None = None

    def steps(self) -> Steps[object]:
        return replayed(run_station(self._context), replay_steps(self._tape()), self._left)

    def receive(self, data: bytes, now: float) -> list[Reply]:
        return self._station.receive(data, now) if self._station else []

    def is_unplugged(self, now: float) -> bool:
        return self._station is not None and self._station.is_unplugged(now)

    def _left(self, astray: Divergence) -> tuple[float, str]:
        self.astray = astray
        if astray.step is None:
            self._context.journal = NoJournal()  # the rest of this session was not recorded
            return inf, ""
        rest = partial(self._tape, astray.step.place)
        self._station = ReplayedStation(self.name, rest, ticks=self._ticks)
        return _end(rest())


def _end(rows: Iterable[CaptureRow]) -> tuple[float, str]:
    """Return when and why the recorded session ended; at the latest `GRACE_S` after its capture."""
    at_s = 0.0
    for row in rows:
        at_s = row.at_s
        if row.what in ERROR_OF_RESULT:
            return at_s, row.text
    return at_s + GRACE_S, "the recording is over"


# -- serving ---------------------------------------------------------------------------------------

# time to pass bytes to another program and back through a pseudo-terminal, in addition to the
# recorded time
HANDING_S = 0.0003


def serve(
    recording: Recording, folder: Path, tcp: Tcp | None = None
) -> tuple[Server, list[ReplayedStation]]:
    """Create ports in `folder` (or on TCP) behind which the recorded stations answer as they did.

    The line file in `folder` names the recipes of the run and the rates that it chose. Raises
    `UsageError` if a link cannot be created.
    """
    specs = tuple(_served(recording, spec) for spec in recording.stations)
    stations = [station_of(recording, spec.name, HANDING_S) for spec in specs]
    line = recording.line.model_copy(update={"stations": specs})
    return set_up(line, folder, tcp, stations=stations, replay=recording.replay), stations


def station_of(recording: Recording, name: str, early_s: float = 0.0) -> ReplayedStation:
    """Return the recorded station of that name."""
    return ReplayedStation(name, partial(recording.exchanges, name), early_s, recording.ticks(name))


def _served(recording: Recording, spec: StationSpec) -> StationSpec:
    """Return the station for the line file of the replay, with the recipe of the run."""
    return spec.model_copy(update={"recipe": recording.recipe_path(spec.name)})
