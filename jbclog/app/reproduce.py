"""Runs the sessions of a captured run again, without ports, and compares every row.

Each session gets the captured results of its requests (`transport.session_history`), so it sends
the same and makes the same rows, to the microsecond; nothing of them is stored. A session that asks
something else than the capture has ends there, as it does where its capture ends.

Compared are all columns but times, which follow the drifting wall clock, and all events of stations
but those that are derived from samples or noted by the recorder itself.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from operator import itemgetter
from pathlib import Path
from typing import Final

import pyarrow.compute as pc

from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import Plan, station_plan
from jbclog.app.run.tasks import station_tasks
from jbclog.config.line import Line, load_line
from jbclog.config.load_recipe import load_recipe
from jbclog.core.clock import UtcOffset, VirtualClock
from jbclog.core.errors import UsageError
from jbclog.core.io_requests import Wait
from jbclog.core.json_files import builder, json_of
from jbclog.core.rows import (
    TABLES,
    CounterRow,
    EventRow,
    Journal,
    NoJournal,
    SampleRow,
    SettingRow,
    StationFacts,
)
from jbclog.record.folder import recipe_copy
from jbclog.record.manifest import Manifest, read_manifest
from jbclog.record.parts import row_groups
from jbclog.record.schema import SCHEMAS, SEQ
from jbclog.record.wire import captured_rows, heads_of
from jbclog.record.wire_recorder import Head
from jbclog.session.run.context import SessionContext
from jbclog.session.run.station_run import run_station
from jbclog.session.run.task import StationTask
from jbclog.transport.session_history import Divergence, replay_steps, replayed

LEFT_OUT: Final = frozenset({"run", "time", "earliest", "seq", "prev_sha256"})
COMPARED: Final = {
    table: [name for name in SCHEMAS[table].names if name not in LEFT_OUT] for table in TABLES
}
OF_RECORDER: Final = ("alarm.episode.", "identity.swapped", "link.contention")
"""Kinds of events of stations that no session makes."""
MOST_SHOWN: Final = 3  # rows of a table that differ; later ones mostly follow from the first

_build_facts: Final = builder(StationFacts)

# -- sessions --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class CapturedRun:
    """A run with a serial capture: its line, and the options of each captured session."""

    folder: Path
    line: Line
    heads: Mapping[str, Head]

    def task(self, station: str) -> StationTask:
        """Return what the run required of the station. Raises `Problems` if line file or recipe are
        no longer valid.
        """
        head = self.heads[station]
        recorded = next(spec for spec in self.line.stations if spec.name == station)
        spec = recorded.model_copy(update={"url": head.url})
        recipe = load_recipe(recipe_copy(self.folder, head.recipe), links=False)
        options = RunOptions(
            self.line.path,
            stations=(station,),
            duration_s=head.duration_s,
            rate=head.rate,
            guard=False,
            allow_omega_write=head.allow_omega_write,
        )
        plan = Plan(self.line, (station_plan(spec, recipe, options),), options)
        (task,) = station_tasks(plan, head.t0_mono)
        return replace(task, may_be_missing=head.allow_missing)


def open_captured(folder: Path) -> CapturedRun:
    """Return the captured run in `folder`. Raises `UsageError` without a capture, RecordError."""
    heads = heads_of(folder)
    if not heads:
        raise UsageError(
            f"{folder}: has no serial capture; only a run recorded with --capture can be reproduced"
        )
    return CapturedRun(folder, load_line(folder / "line.toml"), heads)


def run_again(
    captured: CapturedRun, station: str, journal: Journal
) -> tuple[StationFacts, Divergence | None]:
    """Run the session of `station` on its capture, with its rows to `journal`; return its facts,
    and where it left the capture, if it did. Raises `RecordError`.
    """
    head = captured.heads[station]
    clock = VirtualClock(head.t0_mono, head.t0_utc)
    context = SessionContext.of(captured.task(station), journal, UtcOffset(clock))
    left: list[Divergence] = []

    def leave(divergence: Divergence) -> None:
        left.append(divergence)
        context.log.journal = NoJournal()  # the rest of this session was not captured

    steps = replay_steps(captured_rows(captured.folder, station))
    session = replayed(run_station(context), steps, leave)
    with suppress(StopIteration):
        while True:
            request = session.send(None)
            assert isinstance(request, Wait)  # `replayed` asks for nothing else
            clock.advance_to(request.until)
    return context.state.facts, left[0] if left else None


# -- comparison ------------------------------------------------------------------------------------

Row = tuple[object, ...]


@dataclass(slots=True)
class _Rows:
    """A journal that keeps the compared columns of each row, by table."""

    tables: dict[str, list[Row]] = field(default_factory=lambda: {table: [] for table in TABLES})

    def sample(self, row: SampleRow) -> None:
        self.tables["samples"].append(tuple(row[1:]))  # all but the time

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        self._add("events", event)

    def setting(self, setting: SettingRow) -> None:
        self._add("settings", setting)

    def counter(self, counter: CounterRow) -> None:
        self._add("counters", counter)

    def facts(self, facts: StationFacts) -> None: ...

    def _add(self, table: str, row: EventRow | SettingRow | CounterRow) -> None:
        values = (getattr(row, name) for name in COMPARED[table])
        self.tables[table].append(
            tuple(str(value) if isinstance(value, str) else value for value in values)
        )


@dataclass(slots=True)
class Comparison:
    """A run compared with its reproduction. `compared`: compared and recorded rows by table.

    `differences` are found within what could be compared. `uncompared` says what could not be, and
    should have been; `notes` what a run that was cut off need not have.
    """

    compared: dict[str, list[int]] = field(
        default_factory=lambda: {table: [0, 0] for table in TABLES}
    )
    differences: list[str] = field(default_factory=list)
    uncompared: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        shares = (
            f"{compared} of {recorded} rows of {table}"
            for table, (compared, recorded) in self.compared.items()
        )
        return f"compared from the capture: {', '.join(shares)}"

    def as_json(self) -> dict[str, dict[str, int]]:
        """Return compared and recorded rows by table."""
        return {
            table: {"rows": compared, "recorded": recorded}
            for table, (compared, recorded) in self.compared.items()
        }


def compare_from_capture(folder: Path) -> Comparison:
    """Compare the sealed run in `folder` with what its capture gives. Raises `UsageError` without a
    capture, `RecordError`, `Problems`.
    """
    captured = open_captured(folder)
    manifest = read_manifest(folder)
    comparison = Comparison()
    for facts in manifest.stations:
        _compare_station(captured, manifest, facts, comparison)
    if not sum(compared for compared, _ in comparison.compared.values()):
        comparison.uncompared.append("nothing was compared: the capture holds no row")
    return comparison


def _compare_station(
    captured: CapturedRun, manifest: Manifest, facts: StationFacts, comparison: Comparison
) -> None:
    station = facts.name
    again = _Rows()
    divergence = None
    is_cut = manifest.lost is not None
    if station in captured.heads:
        facts_again, divergence = run_again(captured, station, again)
    else:
        comparison.uncompared.append(f"{station}: has no capture")
        is_cut = True
    if divergence is not None:
        text = f"{station}: {_divergence_text(divergence, captured.heads[station])}"
        texts = comparison.notes if divergence.is_cut_off else comparison.differences
        texts.append(text)
        is_cut = True
    for table in TABLES:
        recorded = _recorded_rows(captured.folder, table, station)
        rows = again.tables[table]
        common = min(len(recorded), len(rows))
        comparison.compared[table][0] += common
        comparison.compared[table][1] += len(recorded)
        comparison.differences += _differing(table, station, recorded, rows)
        if not is_cut and len(rows) != len(recorded):
            comparison.differences.append(
                f"{table}, {station}: {len(rows)} rows instead of {len(recorded)}"
            )
        is_known = manifest.lost is not None and (common > 0 or table != "samples")
        if is_cut and common < len(recorded) and not is_known:
            comparison.uncompared.append(
                f"{table}, {station}: only {common} of {len(recorded)} rows could be compared"
            )
    if not is_cut:
        comparison.differences += _differing_facts(facts, facts_again)


def _recorded_rows(folder: Path, table: str, station: str) -> list[Row]:
    rows: list[tuple[int, Row]] = []
    names = COMPARED[table]
    for group in row_groups(folder, table, [SEQ, *names]):
        mine = group.filter(pc.equal(group["station"], station))
        columns = [mine[name].to_pylist() for name in names]
        rows += zip(mine[SEQ].to_pylist(), zip(*columns, strict=True), strict=True)
    rows.sort(key=itemgetter(0))
    if table != "events":
        return [row for _, row in rows]
    kind = names.index("kind")
    return [row for _, row in rows if not str(row[kind]).startswith(OF_RECORDER)]


def _differing(table: str, station: str, recorded: list[Row], again: list[Row]) -> Iterator[str]:
    pairs = enumerate(zip(recorded, again, strict=False))
    different = [(number, first, second) for number, (first, second) in pairs if first != second]
    for number, first, second in different[:MOST_SHOWN]:
        changes = (
            f"{name} {value!r} instead of {before!r}"
            for name, before, value in zip(COMPARED[table], first, second, strict=True)
            if value != before
        )
        yield f"{table}, {station}, row {number}: {', '.join(changes)}"
    if len(different) > MOST_SHOWN:
        yield f"{table}, {station}: {len(different) - MOST_SHOWN} more rows differ"


def _differing_facts(recorded: StationFacts, again: StationFacts) -> Iterator[str]:
    before = asdict(recorded)
    as_in_manifest = _build_facts(json_of(json.dumps(asdict(again))))
    for name, value in asdict(as_in_manifest).items():
        if value != before[name]:
            yield f"manifest, {recorded.name}: {name} {value!r} instead of {before[name]!r}"


def _divergence_text(divergence: Divergence, head: Head) -> str:
    after = f"{divergence.at_s - head.t0_mono:.1f} s after the run's start"
    if divergence.is_cut_off:
        return f"the capture ends {after}, before its session"
    return f"left the capture {after}: this version acts differently ({divergence})"
