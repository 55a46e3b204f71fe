"""What holds of every run whatever happened to it: I1 to I9 of docs/reference/faults.md, as
sentences about what fails.

`violations` looks at a run's folder and at what the stations themselves noted of their wires
(`station_log.heard_in`, or the `heard` of a `Tap`); `violations_of` at a run on a virtual clock
that was kept in memory. Nothing here is counted or read with the code that made the record, but for
the one question that is put to it: whether `check` agrees (I8).
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pyarrow.parquet as pq

from support.oracles.account import reasons_in, wrong_rows
from support.oracles.listed_writes import strange_writes
from support.product import (
    COLUMN,
    SAMPLE_COLUMNS,
    SIGNAL_COLUMNS,
    SIGNAL_OF_COLUMN,
    Manifest,
    SampleRow,
    StationFacts,
    check_run,
    read_manifest,
)
from support.virtual.virtual_run import Heard, VirtualRun

Wires = Mapping[str, Sequence[Heard]]
"""By station: every question that reached it, in the order of time."""

ORDERS = re.compile(r"W(PS(\d)|STP)")
STAND = "00001"
EXIT_CODES = (0, 1, 2, 3, 4, 5, 130, 143)
FINE = (0,)
NOT_TOLD = "Traceback"
APART_US = 2000  # between a row's time in UTC and its place on the monotonic grid


@dataclass(frozen=True)
class Ended:
    """How the program ended: its exit code (negative: by that signal) and all that it said on
    stderr.
    """

    code: int
    said: str


@dataclass(frozen=True)
class Kept:
    """What a record has: rows of samples, counters as (station, port, name, reason or None), events
    as (time, kind, text).
    """

    samples: list[SampleRow]
    counters: list[tuple[str, str, str, str | None]]
    events: list[tuple[int, str, str]]
    facts: list[StationFacts]
    t0: float
    t0_utc: float

    def of(self, station: str) -> list[SampleRow]:
        return [row for row in self.samples if row[COLUMN["station"]] == station]

    def has(self, kind: str) -> bool:
        return any(found == kind for _, found, _ in self.events)


def violations(
    folder: Path,
    wires: Wires,
    *,
    ended: Ended | None = None,
    died_at: float | None = None,
    as_sent: bool = False,
) -> list[str]:
    """All that does not hold of the sealed run in `folder`.

    `wires` are only of this run's time. `died_at` is when its recorder was killed (monotonic
    seconds), where it was. `as_sent`: what a fault made of an answer counts as said (I4 allows it
    where the injector counts it itself).
    """
    found = [f"I8: {finding}" for finding in check_run(folder)]
    if any("cannot be read" in text or "has no part" in text for text in found):
        return found
    manifest, kept = read_manifest(folder), kept_in(folder)
    found += _common(kept, wires, as_sent)
    recipes = {
        one.name: (folder / "recipes" / Path(one.recipe).name).read_text("utf-8")
        for one in manifest.stations
        if one.recipe
    }
    found += _unlisted(kept.facts, wires, recipes)
    found += _ledger(manifest, kept)
    found += _losses(manifest, kept, wires, died_at)
    found += _made_safe(manifest, wires)
    return [*found, *(_said(ended, manifest) if ended is not None else ())]


def violations_of(run: VirtualRun, *, as_sent: bool = False) -> list[str]:
    """The same of a run in memory, as far as there is no folder to look at."""
    facts = [context.facts for context in run.contexts.values()]
    counters = [
        (one.station, str(one.port), one.counter, _reason(one.value, one.raw))
        for one in run.memory.counters
    ]
    events = [(event.time, event.kind, event.text) for event in run.memory.events]
    kept = Kept(run.memory.samples, counters, events, facts, run.t0, run.utc_s(run.t0))
    wires = {name: tap.heard for name, tap in run.taps.items()}
    recipes = {context.name: context.recipe.text for context in run.contexts.values()}
    return [*_common(kept, wires, as_sent), *_unlisted(facts, wires, recipes), *_due(kept)]


def kept_in(folder: Path) -> Kept:
    """What is sealed in a folder, read without the record's own code."""
    manifest = read_manifest(folder)
    rows = _columns(folder, "samples", SAMPLE_COLUMNS)
    counters = [
        (str(station), str(port), str(name), _reason(value, str(raw)))
        for station, port, name, value, raw in _columns(
            folder, "counters", ("station", "port", "counter", "value", "raw")
        )
    ]
    events = [
        (int(str(time)), str(kind), str(text))
        for time, kind, text in _columns(folder, "events", ("time", "kind", "text"))
    ]
    return Kept(
        [list(row) for row in rows],
        counters,
        events,
        manifest.stations,
        manifest.t0_mono or 0.0,
        manifest.t0_utc or 0.0,
    )


def _whole(row: SampleRow, column: str) -> int:
    return int(str(row[COLUMN[column]]))


def _reason(value: object, raw: str) -> str | None:
    return raw.strip("<>") if value is None else None


def _columns(folder: Path, table: str, names: Sequence[str]) -> Iterator[tuple[object, ...]]:
    """The rows of a table; times as whole microseconds."""
    for path in sorted(
        (folder / table).glob("part-*.parquet"), key=lambda path: int(path.stem.partition("-")[2])
    ):
        rows = pq.read_table(path)
        columns = [rows[name].cast("int64") if name == "time" else rows[name] for name in names]
        yield from zip(*(column.to_pylist() for column in columns), strict=True)


# -- I1, I4, I5, I7: of rows and wires alone -------------------------------------------------------


def _common(kept: Kept, wires: Wires, as_sent: bool) -> Iterator[str]:
    for facts in kept.facts:
        rows, heard = kept.of(facts.name), wires.get(facts.name, ())
        yield from (f"I1: {facts.name}: {text}" for text in _values_with_reasons(rows))
        if facts.period_s is not None and facts.family != "omega":
            wrong = wrong_rows(
                rows, heard, kept.t0, facts.period_s, as_sent=as_sent, is_air=facts.family == "jtse"
            )
            yield from (f"I4: {facts.name}: {text}" for text in wrong)
        yield from (f"I5: {facts.name}: {text}" for text in _times(kept, facts, rows))
    yield from (f"I4: rows of {name}, which is no station of the run" for name in _strangers(kept))


def _strangers(kept: Kept) -> set[str]:
    return {str(row[COLUMN["station"]]) for row in kept.samples} - {
        facts.name for facts in kept.facts
    }


def _values_with_reasons(rows: Iterable[SampleRow]) -> Iterator[str]:
    for row in rows:
        for column in reasons_in(row):
            if row[COLUMN[column]] is not None:
                yield (
                    f"tick {row[COLUMN['tick']]}: {column} has a value and a reason why there is"
                    " none"
                )


def _times(kept: Kept, facts: StationFacts, rows: list[SampleRow]) -> Iterator[str]:
    """Ticks rise one by one; times do not go back, and lie where the ticks say, whatever the host's
    clock does.
    """
    for port in sorted({_whole(row, "port") for row in rows}):
        mine = [row for row in rows if row[COLUMN["port"]] == port]
        ticks = [_whole(row, "tick") for row in mine]
        yield from (
            f"port {port}: tick {two} after tick {one}"
            for one, two in pairwise(ticks)
            if two <= one
        )
        yield from (
            f"port {port}: {two} after {one} in UTC microseconds"
            for one, two in pairwise(_whole(row, "time") for row in mine)
            if two < one
        )
        if facts.period_s is not None and not kept.has("host.suspended"):
            yield from (
                f"port {port}: {text}" for text in _off_the_grid(kept, facts.period_s, mine)
            )


def _off_the_grid(kept: Kept, period_s: float, rows: list[SampleRow]) -> Iterator[str]:
    for row in rows:
        late, scan = row[COLUMN["late_us"]], row[COLUMN["scan_us"]]
        if (
            isinstance(late, int)
            and isinstance(scan, int)
            and row[COLUMN["temperature_c"]] is not None
        ):
            begin = (kept.t0_utc + _whole(row, "tick") * period_s) * 1e6 + late
            after = _whole(row, "time") - begin
            if not -APART_US <= after <= scan + APART_US:
                yield (
                    f"tick {row[COLUMN['tick']]} is answered {after / 1e6:.6f} s after its question"
                )


def _unlisted(
    stations: Iterable[StationFacts], wires: Wires, recipes: Mapping[str, str]
) -> Iterator[str]:
    """Whatever was written is the recipe's or a safe state; OMEGA's D is looked at by tests that
    allow it.
    """
    for facts in stations:
        heard = [
            one
            for one in wires.get(facts.name, ())
            if facts.family != "omega" or one.text[:1] != "D"
        ]
        for text in strange_writes(
            heard, facts.family, recipes.get(facts.name, ""), facts.ports or None
        ):
            yield f"I7: {facts.name}: {text} was written"


# -- I2: the account -------------------------------------------------------------------------------


def counted(kept: Kept) -> dict[tuple[str, str, str], Counter[str]]:
    """For each station, port and signal: how often it came (``ok``), and how often each reason
    stands in its place.
    """
    found: dict[tuple[str, str, str], Counter[str]] = {}
    for row in kept.samples:
        place, reasons = (str(row[COLUMN["station"]]), str(row[COLUMN["port"]])), reasons_in(row)
        for column in SIGNAL_COLUMNS:
            word = "ok" if row[COLUMN[column]] is not None else reasons.get(column)
            if SIGNAL_OF_COLUMN[column] == column and word is not None:
                found.setdefault((*place, column), Counter())[word] += 1
    for station, port, name, reason in kept.counters:
        found.setdefault((station, "station" if port == "None" else port, name), Counter())[
            reason or "ok"
        ] += 1
    return found


def _due(kept: Kept, *, whole: bool = True) -> Iterator[str]:
    """Every tick has its row, and every reading counted as due a value or a reason."""
    rows = counted(kept)
    for facts in kept.facts:
        yield from (f"I2: {facts.name}: {text}" for text in _missing_ticks(kept, facts))
        for port, signals in facts.due.items() if whole else ():
            for signal, due in signals.items():
                if signal not in facts.watched.get(port, {}):
                    found = sum(rows.get((facts.name, port, signal), Counter()).values())
                    if found < due or (found > due and signal in SIGNAL_COLUMNS):
                        yield (
                            f"I2: {facts.name}: {signal} of port {port}: {due} were due, {found}"
                            " are accounted for"
                        )


def _missing_ticks(kept: Kept, facts: StationFacts) -> Iterator[str]:
    """Within what is there: what a kill took from the end is another matter."""
    rows = kept.of(facts.name)
    for port in sorted({_whole(row, "port") for row in rows}):
        ticks = [_whole(row, "tick") for row in rows if row[COLUMN["port"]] == port]
        missing = ticks[-1] - ticks[0] + 1 - len(ticks)
        if missing != facts.skipped and not (
            missing < facts.skipped and facts.outcome == "running"
        ):
            yield (
                f"{missing} ticks of port {port} have no row, {facts.skipped} are known to be"
                " skipped"
            )


def _ledger(manifest: Manifest, kept: Kept) -> Iterator[str]:
    """The manifest's ledger against the rows; what was lost for a reason that has no seconds cannot
    be counted.
    """
    rows, gone = counted(kept), {facts.name: facts.skipped for facts in kept.facts}
    for station, ports in manifest.ledger.items():
        for port, signals in ports.items():
            for signal, account in signals.items():
                words = {word: count for word, count in account.items() if word != "due" and count}
                if sum(words.values()) != account["due"]:
                    yield f"I2: {station} port {port}: {signal}: {account} does not add up"
                found = dict(rows.get((station, port, signal), Counter()))
                # rows say so too, of what came too late
                skipped = words.pop("skipped", 0) - found.pop("skipped", 0)
                if (signal in SIGNAL_COLUMNS or found) and (
                    found != words or skipped not in (0, gone.get(station, 0))
                ):
                    yield (
                        f"I2: {station} port {port}: {signal}: the ledger has {account}, the rows"
                        f" {found}"
                    )
    if manifest.lost is None or manifest.lost.seconds_at_most is not None:
        yield from _due(kept, whole=manifest.lost is None)


# -- I3: what a kill may take ----------------------------------------------------------------------


def _losses(manifest: Manifest, kept: Kept, wires: Wires, died_at: float | None) -> Iterator[str]:
    """All that was answered longer before the death than the manifest admits is in a row."""
    if died_at is None:
        return
    if manifest.exit_status not in ("lost", None) and manifest.lost is None:
        # the kill came after the record was closed; its own account has been held against it
        return
    if manifest.lost is None or manifest.exit_status != "lost":
        yield (
            f"I3: the recorder was killed, the manifest says {manifest.exit_status} and"
            f" {manifest.lost}"
        )
    elif manifest.lost.seconds_at_most is not None:
        for facts in kept.facts:
            yield from _lost_rows(
                kept, facts, wires.get(facts.name, ()), died_at - manifest.lost.seconds_at_most
            )


def _lost_rows(
    kept: Kept, facts: StationFacts, heard: Sequence[Heard], safe_until: float
) -> Iterator[str]:
    """Temperatures that were told while the run sampled, before `safe_until`, later than the last
    row of their port.
    """
    if facts.period_s is None:
        return
    for port in facts.ports:
        ticks = [_whole(row, "tick") for row in kept.of(facts.name) if row[COLUMN["port"]] == port]
        recorded = kept.t0 + (ticks[-1] + 1) * facts.period_s if ticks else None
        asked = [one.at for one in heard if one.text == f"RTT{port}" and one.sent is not None]
        late = [
            at
            for at in asked
            if recorded is not None and recorded < at < safe_until - facts.period_s
        ]
        if late:
            more = safe_until - late[0]
            yield (
                f"I3: {facts.name} port {port}: {len(late)} readings are lost, up to {more:.3f} s"
                " more than admitted"
            )


# -- I7 and safety: what is left hot ---------------------------------------------------------------


def _made_safe(manifest: Manifest, wires: Wires) -> Iterator[str]:
    """The last that was ordered of every tool that the run wrote to is to stand, or the record says
    that it is not known.
    """
    for facts in manifest.stations:
        orders: dict[str, str] = {}
        for one in wires.get(facts.name, ()):
            if one.is_write and (order := ORDERS.match(one.text)) and order[2]:
                orders[order[2]] = one.text[4:]
        for port, status in orders.items():
            if facts.family in ("jtse", "omega") or (status == STAND):
                continue
            if not any(f"port {port}:" in text for text in facts.unsafe):
                yield (
                    f"unsafe: {facts.name} port {port} was last told {status}, and the record does"
                    f" not say so: {facts.unsafe}"
                )


# -- I9: how it ended ------------------------------------------------------------------------------


def _said(ended: Ended, manifest: Manifest) -> Iterator[str]:
    if NOT_TOLD in ended.said:
        yield f"I9: a traceback: {ended.said[-2000:]}"
    if ended.code >= 0 and ended.code not in EXIT_CODES:
        yield f"I9: exit code {ended.code}"
    if ended.code > 0 and not re.search(rf"exit {ended.code}: |error: ", ended.said):
        yield f"I9: exit code {ended.code} without a sentence: {ended.said[-500:]}"
    if ended.code in (0, 1, 3) and manifest.exit_status not in ("success", "aborted", "failed"):
        yield f"I9: exit code {ended.code}, and the record says {json.dumps(manifest.exit_status)}"


def lateness(kept: Kept, station: str, percent: float = 99.0) -> float:
    """The lateness in seconds that `percent` of a station's ticks do not exceed (I6 compares two
    runs of one seed).
    """
    late = sorted(
        _whole(row, "late_us") for row in kept.of(station) if row[COLUMN["late_us"]] is not None
    )
    return late[min(int(len(late) * percent / 100), len(late) - 1)] / 1e6 if late else 0.0
