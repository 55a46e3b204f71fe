"""A recorded run once more: lived through without any port, as fast as the machine can, or served on ports.

Lived through, each session is told what it was told then (`drive.told`) and so does the same, and the tables come out
the same, to the microsecond. Where the program is not the same any more and asks something else, its session goes on
with the tape as its station (`sim.tape`) on a virtual clock.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from math import inf
from pathlib import Path

from jbclog.clock import VirtualClock
from jbclog.dossier import Dossier, Observer, Result
from jbclog.drive.told import Astray, reliving, steps_of
from jbclog.drive.virtual import VirtualDriver
from jbclog.effects import Steps
from jbclog.errors import UsageError
from jbclog.plan import Metadata, Plan, Wanted, station_plan
from jbclog.recipe.line import Line, StationSpec, load_line
from jbclog.recipe.load import load_recipe
from jbclog.record import wire_check
from jbclog.record.compare import differences
from jbclog.record.manifest import NAME, Lost, Manifest, read_manifest
from jbclog.record.wire import Head, read_exchanges, read_to_hole, wire_path, wire_paths
from jbclog.rows import NoJournal, StationFacts
from jbclog.session.order import AS_FIT, Desk
from jbclog.session.run import run_station
from jbclog.sim.serve import Server
from jbclog.sim.setup import Tcp, set_up
from jbclog.sim.tape import TapeStation
from jbclog.sim.virtual import Reply
from jbclog.tape import Row
from jbclog.wire import BAUDRATES

HANDING_S = 0.0003  # that bytes take from one program to another and back through a pseudo-terminal, beside the wire's time
GRACE_S = 5.0  # that a session which left its tape may still take once the tape is over
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
        return self.folder / "recipes" / self.heads[station].recipe

    def tape(self, station: str, first: int = 0) -> Iterator[Row]:
        """The rows of a station's wire from number `first` on, up to where something of it is missing."""
        return read_to_hole(wire_path(self.folder, station), first)

    def exchanges(self, station: str) -> Iterator[Row]:
        """The rows of a station's wire as far as each question has what came of it."""
        return read_exchanges(wire_path(self.folder, station))

    @property
    def doubts(self) -> list[str]:
        """What of the recording is missing, or was changed since, a sentence each. Raises `RecordError`."""
        return wire_check.doubts(self.folder, self.manifest)

    @property
    def manifest(self) -> Manifest | None:
        """The run's manifest, where it had come to writing one."""
        return read_manifest(self.folder) if (self.folder / NAME).exists() else None

    @property
    def rate(self) -> float | str | None:
        """The rate that was asked for; for ``fit`` the one that came of it, where that is the same for all stations."""
        found = {facts.period_s for facts in self.manifest.stations if facts.period_s} if self.manifest else set()
        return round(1 / found.pop(), 6) if self.first.rate == AS_FIT and len(found) == 1 else self.first.rate

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
        tags = {REPLAY_OF: self.folder.resolve().name}
        if self.manifest is None:
            return Metadata(tags=tags)
        told = self.manifest.metadata
        return Metadata(told.operator, told.order, told.product, tuple(told.units), told.tags | tags)


def _sampled_s(facts: StationFacts) -> float | None:
    if facts.first_tick is None or facts.last_tick is None or facts.period_s is None:
        return None
    return (facts.last_tick - facts.first_tick + 1) * facts.period_s


def open_recording(folder: Path) -> Recording:
    """The recording in a run's folder. Raises `UsageError` where no wire was kept, `RecordError` where none is readable."""
    paths = wire_paths(folder)
    if not paths:
        raise UsageError(f"{folder}: what passed over its wires was not kept; only a run with --wire can be replayed")
    heads = {head.station: head for head in wire_check.readable_heads(paths)}
    return Recording(folder, load_line(folder / "line.toml"), heads)


def plan_of(recording: Recording) -> Plan:
    """The plan that was run. Raises `Problems` where line file or recipe are none any more."""
    head = recording.first
    wanted = Wanted(
        recording.line.path,
        stations=tuple(recording.heads),
        duration_s=head.duration_s,
        rate=head.rate,
        metadata=recording.metadata,
        guard=False,
        allow_omega_write=head.allow_omega_write,
    )
    stations = (station_plan(spec, load_recipe(recording.recipe_path(spec.name)), wanted) for spec in recording.stations)
    return Plan(recording.line, tuple(stations), wanted)


# -- lived through once more ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Again:
    """What living through a run once more came to, and which sessions left their tapes where."""

    result: Result
    left: Mapping[str, Astray]


def record_again(recording: Recording, out: Path, observer: Observer) -> Again:
    """Live through the run and record that below `out`. Raises `RecordError` where it cannot be kept, or the tape be read."""
    clock = VirtualClock(recording.first.t0_mono, recording.first.t0_utc)
    dossier = Dossier(plan_of(recording), out, observer, clock)
    dossier.begin()
    left = relive(recording, dossier.desks, clock)
    cut_off = [name for name, astray in left.items() if astray.is_cut_off]
    lost = f"The recording of {', '.join(cut_off)} ends before its run did." if cut_off else None
    dossier.manifest.lost = Lost(None, lost) if lost else None
    return Again(dossier.conclude(dossier.close() or lost), left)


def compare(recording: Recording, again: Again) -> list[str] | None:
    """What came out otherwise, as sentences; None where the recorded run is not sealed and so has no tables yet."""
    manifest = recording.manifest
    if manifest is None or manifest.state != "sealed":
        return None
    cut_off = manifest.lost is not None or any(astray.is_cut_off for astray in again.left.values())
    return differences(recording.folder, again.result.folder, prefix=cut_off)


def relive(recording: Recording, desks: Iterable[Desk], clock: VirtualClock) -> dict[str, Astray]:
    """Run the sessions of `desks` on what was recorded; give where they left it, by station, if they did."""
    driver = VirtualDriver(clock)
    lives = [_Life(recording, desk) for desk in desks]
    for life in lives:
        driver.add(life.steps(), life)
    driver.run()
    return {life.name: life.astray for life in lives if life.astray is not None}


class _Life:
    """The second life of one session, and the station that it needs only where it leaves its tape."""

    def __init__(self, recording: Recording, desk: Desk) -> None:
        self.name = desk.name
        self.astray: Astray | None = None
        self._desk = desk
        self._tape = partial(recording.tape, desk.name)
        self._station: TapeStation | None = None

    def steps(self) -> Steps[object]:
        return reliving(run_station(self._desk), steps_of(self._tape()), self._left)

    def receive(self, data: bytes, now: float) -> list[Reply]:
        return self._station.receive(data, now) if self._station else []

    def hung_up(self, now: float) -> bool:
        return self._station is not None and self._station.hung_up(now)

    def _left(self, astray: Astray) -> tuple[float, str]:
        self.astray = astray
        if astray.step is None:
            self._desk.journal = NoJournal()  # what a session does that is given up was not recorded
            return inf, ""
        rest = partial(self._tape, astray.step.place)
        self._station = TapeStation(self.name, rest)
        return _end(rest())


def _end(rows: Iterable[Row]) -> tuple[float, str]:
    """When and why a session was ended then; at the latest some seconds after its tape."""
    at_s = 0.0
    for row in rows:
        at_s = row.at_s
        if row.what == "stopped":
            return at_s, row.text
    return at_s + GRACE_S, "the recording is over"


# -- served on ports ---------------------------------------------------------------------------------------------------------


def serve(recording: Recording, folder: Path, tcp: Tcp | None = None, speed: float = 1.0) -> tuple[Server, list[TapeStation]]:
    """Make ports appear in `folder` (or on TCP) behind which the recorded stations answer as they did, `speed` times as fast.

    The line file in `folder` names the recipes that ran. Raises `UsageError` where a link cannot be made.
    """
    specs = tuple(_served(recording, spec, speed) for spec in recording.stations)
    stations = [TapeStation(spec.name, partial(recording.exchanges, spec.name), speed, HANDING_S) for spec in specs]
    line = recording.line.model_copy(update={"stations": specs})
    return set_up(line, folder, tcp, stations=stations), stations


def _served(recording: Recording, spec: StationSpec, speed: float) -> StationSpec:
    """The station as its line file for the replay has it; a faster one has a faster line, on which a higher rate fits."""
    wanted = spec.baudrate * speed
    baudrate = next((rate for rate in BAUDRATES if rate >= wanted), BAUDRATES[-1])
    return spec.model_copy(update={"recipe": recording.recipe_path(spec.name), "baudrate": baudrate})
