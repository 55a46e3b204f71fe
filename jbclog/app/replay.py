"""A recorded run once more: reproduced from its serial captures without a port, or served as virtual stations."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from pathlib import Path

from jbclog.app.run.plan import Metadata, Plan, RunOptions, StationPlan, station_plan
from jbclog.app.run.run_record import Observer, Result, RunRecord
from jbclog.config.line import Line, Replay, StationSpec, load_line
from jbclog.config.load_recipe import load_recipe
from jbclog.core.capture_rows import CaptureRow, ResultRow
from jbclog.core.clock import VirtualClock
from jbclog.core.errors import UsageError
from jbclog.core.io_requests import Steps
from jbclog.core.rows import NoJournal, StationFacts
from jbclog.record import sealed_files
from jbclog.record.capture import Head, read_exchanges, read_to_hole, wire_path, wire_paths
from jbclog.record.compare import Compared, Comparison, compare_records
from jbclog.record.folder import recipe_copy
from jbclog.record.manifest import NAME, Lost, Manifest, read_manifest
from jbclog.record.schema import TABLES
from jbclog.session.run.context import AS_FAST_AS_POSSIBLE, SessionContext
from jbclog.session.run.station_run import run_station
from jbclog.sim.recorded_exchanges import RecordedGrid
from jbclog.sim.replayed_station import ReplayedStation
from jbclog.sim.serve import Server
from jbclog.sim.setup import Tcp, set_up
from jbclog.sim.virtual import Reply
from jbclog.transport.session_history import ERROR_OF_RESULT, Divergence, replay_steps, replayed
from jbclog.transport.virtual import VirtualDriver

# -- recording ----------------------------------------------------------------------------------------------------------------
# A recorded run: its folder, its line, what each of its sessions was ordered, and the plan that comes of that.

REPLAY_OF = "replay_of"  # the tag that names the run which was lived through


@dataclass(frozen=True, slots=True)
class Recording:
    """A run whose wires were kept: its folder, its line, and what each of its sessions was ordered."""

    folder: Path
    line: Line
    heads: Mapping[str, Head]

    @property
    def stations(self) -> list[StationSpec]:
        """The stations whose wires were kept, in the line's order, as their sessions knew them."""
        named = [spec for spec in self.line.stations if spec.name in self.heads]
        return [spec.model_copy(update={"url": self.heads[spec.name].url}) for spec in named]

    @property
    def first(self) -> Head:
        """What all of its sessions have in common."""
        return next(iter(self.heads.values()))

    def recipe_path(self, station: str) -> Path:
        return recipe_copy(self.folder, self.heads[station].recipe)

    def ticks(self, station: str) -> RecordedGrid | None:
        """The grid on which a station was sampled, on the recorder's clock. None where that is not known, or there was none."""
        facts = self.facts.get(station)
        if facts is None or facts.first_tick is None or facts.period_s is None or self.line.replay is not None:
            return None
        return RecordedGrid(self.heads[station].t0_mono + facts.first_tick * facts.period_s, facts.period_s)

    @property
    def facts(self) -> Mapping[str, StationFacts]:
        """What the manifest knows of the stations, by name."""
        return {one.name: one for one in self.manifest.stations} if self.manifest else {}

    @property
    def replay(self) -> Replay:
        """How the run is recorded again: at the rates that came of it, on grids that lie as they did."""
        known = [name for name in self.heads if self.ticks(name) is not None]
        first_tick = {name: self.facts[name].first_tick or 0 for name in known}
        return Replay(rate_hz=self.rates_hz, first_tick=first_tick, first_in_s={name: self._first_in_s(name) for name in known})

    def _first_in_s(self, station: str) -> float:
        """How long after the last that its session was told before its first tick that was due."""
        ticks, last_s = self.ticks(station), 0.0
        assert ticks is not None
        for row in self.tape(station):
            if row.at_s >= ticks.first_s:
                break
            last_s = row.at_s if isinstance(row, ResultRow) and row.what == "told" else last_s
        return ticks.first_s - last_s

    def tape(self, station: str, first: int = 0) -> Iterator[CaptureRow]:
        """The rows of a station's wire from number `first` on, up to where something of it is missing."""
        return read_to_hole(wire_path(self.folder, station), first)

    def exchanges(self, station: str) -> Iterator[CaptureRow]:
        """The rows of a station's wire as far as each question has what came of it."""
        return read_exchanges(wire_path(self.folder, station))

    @property
    def doubts(self) -> list[str]:
        """What of the recording is missing, or was changed since, a sentence each. Raises `RecordError`."""
        return sealed_files.doubts(self.folder, self.manifest)

    @property
    def manifest(self) -> Manifest | None:
        """The run's manifest, where it had come to writing one."""
        return read_manifest(self.folder) if (self.folder / NAME).exists() else None

    @property
    def is_damaged(self) -> bool:
        """Whether something of it is missing or was changed since. Raises `RecordError`."""
        return bool(self.doubts)

    @property
    def is_paced(self) -> bool:
        """Whether it was sampled on a grid, and not as fast as the wire could."""
        return self.first.rate != AS_FAST_AS_POSSIBLE

    @property
    def rates_hz(self) -> dict[str, float]:
        """The rate that came of what was asked for, by station, as far as it is known."""
        return {name: round(1 / one.period_s, 9) for name, one in self.facts.items() if one.period_s and self.is_paced}

    @property
    def sampled_s(self) -> float | None:
        """How long the run sampled on its grid: as long as was asked, or until somebody ended it. None where that is not known."""
        if self.first.duration_s is not None:
            return self.first.duration_s
        facts = self.manifest.stations if self.manifest else []
        spans = [_sampled_s(one) for one in facts]
        return max((span for span in spans if span is not None), default=None)

    @property
    def metadata(self) -> Metadata:
        """What was said of the run, with a tag that tells what this is."""
        tags = {REPLAY_OF: Path(os.path.realpath(self.folder)).name}
        if self.manifest is None:
            return Metadata(tags=tags)
        told = self.manifest.metadata
        lots = tuple(told.wire_lots), tuple(told.flux_lots)
        return Metadata(told.operator, told.order, told.product, tuple(told.units), told.tags | tags, *lots, tuple(told.tips))


def _sampled_s(facts: StationFacts) -> float | None:
    if facts.first_tick is None or facts.last_tick is None or facts.period_s is None:
        return None
    return (facts.last_tick - facts.first_tick + 1) * facts.period_s


def open_recording(folder: Path) -> Recording:
    """The recording in a run's folder. Raises `UsageError` where no wire was kept, `RecordError` where none is readable."""
    paths = wire_paths(folder)
    if not paths:
        raise UsageError(f"{folder}: what passed over its wires was not kept; only a run with --wire can be replayed")
    heads = {head.station: head for head in sealed_files.readable_heads(paths)}
    return Recording(folder, load_line(folder / "line.toml"), heads)


def plan_of(recording: Recording) -> Plan:
    """The plan that was run. Raises `Problems` where line file or recipe are none any more."""
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
    """Stations of one run may have rates of their own, where the run was itself a replay."""
    recipe = load_recipe(recording.recipe_path(spec.name), links=False)
    return station_plan(spec, recipe, replace(wanted, rate=recording.heads[spec.name].rate))


# -- reproduce ----------------------------------------------------------------------------------------------------------------
# A recorded run lived through once more, without any port and as fast as the machine can, and held against the first time.
#
# Each session receives what it received then (`transport.session_history`) and so does the same, and the tables come out the
# same, to the microsecond. Where the program is not the same any more and asks something else, its session continues with the
# capture as its station (`sim.tape`) on a virtual clock.

GRACE_S = 5.0  # that a session which left its tape may still take once the tape is over


@dataclass(frozen=True, slots=True)
class Again:
    """The result of reproducing a run, and which sessions left their captures where."""

    result: Result
    left: Mapping[str, Divergence]

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


def relive(recording: Recording, contexts: Iterable[SessionContext], clock: VirtualClock) -> dict[str, Divergence]:
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
            self._context.journal = NoJournal()  # what a session does that is given up was not recorded
            return inf, ""
        rest = partial(self._tape, astray.step.place)
        self._station = ReplayedStation(self.name, rest, ticks=self._ticks)
        return _end(rest())


def _end(rows: Iterable[CaptureRow]) -> tuple[float, str]:
    """When and why a session was ended then; at the latest some seconds after its tape."""
    at_s = 0.0
    for row in rows:
        at_s = row.at_s
        if row.what in ERROR_OF_RESULT:
            return at_s, row.text
    return at_s + GRACE_S, "the recording is over"


# -- serving ------------------------------------------------------------------------------------------------------------------

HANDING_S = 0.0003  # time to pass bytes to another program and back through a pseudo-terminal, in addition to the recorded time


def serve(recording: Recording, folder: Path, tcp: Tcp | None = None) -> tuple[Server, list[ReplayedStation]]:
    """Create ports in `folder` (or on TCP) behind which the recorded stations answer as they did.

    The line file in `folder` names the recipes of the run and the rates that it chose. Raises `UsageError` where a link cannot be
    made.
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
