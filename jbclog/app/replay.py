"""Reproduces a recorded run from its serial captures, without ports."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from jbclog.app.run.options import Metadata, RunOptions
from jbclog.app.run.plan import Plan, StationPlan, station_plan
from jbclog.app.run.run_record import Observer, Result, RunRecord
from jbclog.config.line import Line, StationSpec, load_line
from jbclog.config.load_recipe import load_recipe
from jbclog.core.capture_rows import CaptureRow
from jbclog.core.clock import VirtualClock
from jbclog.core.errors import UsageError
from jbclog.core.io_requests import Steps
from jbclog.core.rows import TABLES, NoJournal
from jbclog.record import sealed_files
from jbclog.record.capture import Head, read_to_hole, wire_path, wire_paths
from jbclog.record.compare import Compared, Comparison, compare_records
from jbclog.record.folder import recipe_copy
from jbclog.record.manifest import NAME, Lost, Manifest, read_manifest
from jbclog.session.run.context import SessionContext
from jbclog.session.run.station_run import run_station
from jbclog.transport.session_history import Divergence, replay_steps, replayed
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

    def tape(self, station: str) -> Iterator[CaptureRow]:
        """Return the rows of a station's capture up to the first gap."""
        return read_to_hole(wire_path(self.folder, station))

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
# its session ends there, as it does where its capture ends: nothing behind that point was recorded.


@dataclass(frozen=True, slots=True)
class Again:
    """Result of reproducing a run, and where sessions left their captures before their end."""

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
    lost = _lost_text(left)
    run_record.manifest.lost = Lost(None, lost) if lost else None
    return Again(run_record.conclude(run_record.close() or lost), left)


def _lost_text(left: Mapping[str, Divergence]) -> str | None:
    """Return which sessions were not reproduced to their end, in a sentence each."""
    cut_off = [name for name, astray in left.items() if astray.is_cut_off]
    diverged = [name for name, astray in left.items() if not astray.is_cut_off]
    sentences = []
    if cut_off:
        sentences.append(f"The recording of {', '.join(cut_off)} ends before its run did.")
    if diverged:
        sentences.append(f"This version departs from the recording of {', '.join(diverged)}.")
    return " ".join(sentences) or None


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
    is_cut = manifest.lost is not None or bool(again.left) or bool(unkept)
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
    left: dict[str, Divergence] = {}
    for context in contexts:
        driver.add(_replayed_session(recording, context, left), _NoPeer())
    driver.run()
    return left


def _replayed_session(
    recording: Recording, context: SessionContext, left: dict[str, Divergence]
) -> Steps[object]:
    """Return a session on its capture; where it leaves it, `left` gets its divergence."""

    def leave(astray: Divergence) -> None:
        left[context.name] = astray
        context.journal = NoJournal()  # the rest of this session was not recorded

    return replayed(run_station(context), replay_steps(recording.tape(context.name)), leave)


class _NoPeer:
    """The other end of a replayed session's link, to which nothing is ever sent."""

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        return []

    def is_unplugged(self, now: float) -> bool:
        return False
