"""A recorded run: its folder, its line, what each of its sessions was ordered, and the plan that comes of that."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from jbclog.app.run.plan import Metadata, Plan, RunOptions, StationPlan, station_plan
from jbclog.config.line import Line, Replay, StationSpec, load_line
from jbclog.config.load_recipe import load_recipe
from jbclog.core.errors import UsageError
from jbclog.core.rows import StationFacts
from jbclog.core.wire import Row, Told
from jbclog.record import sealed_files
from jbclog.record.capture import Head, read_exchanges, read_to_hole, wire_path, wire_paths
from jbclog.record.folder import recipe_copy
from jbclog.record.manifest import NAME, Manifest, read_manifest
from jbclog.session.run.context import AS_FAST_AS_POSSIBLE
from jbclog.sim.recorded_wire import Ticks

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

    def ticks(self, station: str) -> Ticks | None:
        """The grid on which a station was sampled, on the recorder's clock. None where that is not known, or there was none."""
        facts = self.facts.get(station)
        if facts is None or facts.first_tick is None or facts.period_s is None or self.line.replay is not None:
            return None
        return Ticks(self.heads[station].t0_mono + facts.first_tick * facts.period_s, facts.period_s)

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
            last_s = row.at_s if isinstance(row, Told) and row.what == "told" else last_s
        return ticks.first_s - last_s

    def tape(self, station: str, first: int = 0) -> Iterator[Row]:
        """The rows of a station's wire from number `first` on, up to where something of it is missing."""
        return read_to_hole(wire_path(self.folder, station), first)

    def exchanges(self, station: str) -> Iterator[Row]:
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
