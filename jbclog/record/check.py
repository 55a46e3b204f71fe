"""Integrity check of a sealed run: compare its files and tables with the manifest, and run
`cross_check`.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.core.files import DEEPEST, is_plain_folder
from jbclog.core.rows import SIGNAL_COLUMNS, TABLES, quality_of
from jbclog.core.text import count_text, shortened
from jbclog.record import chains, wire
from jbclog.record.clock_steps import KIND as STEP
from jbclog.record.clock_steps import listed_steps
from jbclog.record.conclude import is_later, live_files, sealed_file
from jbclog.record.cross_check import cross_check
from jbclog.record.folder import DERIVED
from jbclog.record.guard_actions import event_dicts
from jbclog.record.ledger import disagreements, ledger_of, reasons_of
from jbclog.record.manifest import (
    NAME,
    Ledger,
    Manifest,
    SealedFile,
    fitting_units,
    read_manifest,
    wrong_digest,
)
from jbclog.record.old_names import OLD_SCHEMA
from jbclog.record.part_file import CHANGED, open_part
from jbclog.record.parts import SORTED, groups_of, part_paths, read_through, row_groups
from jbclog.record.row_batches import NUMBERED
from jbclog.record.samples_by_port import split_by_port
from jbclog.record.schema import CAPTURE, INT, SCHEMAS, SEQ
from jbclog.record.units import units_of

NOT_LISTED: Final = "is not in the manifest"
MOST_OF_A_KIND: Final = 100  # findings
LONGEST: Final = 2000  # characters of a finding that repeats text of the tables
# a crash at the start, or while something is derived, leaves them empty
MAY_BE_EMPTY: Final = ("recipes", CAPTURE, "figures", "tables", DERIVED)

OLD_CAPTURE: Final = ".tsv.gz"
"""Of jbclog 0.1.0, compared by its hash."""


class Finding(NamedTuple):
    """A disagreement, and the file that shows it."""

    file: str
    text: str

    def __str__(self) -> str:
        return f"{self.file}: {self.text}"


def check(folder: Path, head: str | None = None, *, with_report: bool = True) -> list[Finding]:
    """Return every disagreement within the run. Raises `RecordError` if the folder is not a run.

    `head` is an earlier fingerprint of the run, from a report. `with_report`: False for a copy of a
    published run, which has no report.
    """
    manifest = read_manifest(folder)
    digest = wrong_digest(folder)
    findings = [Finding(NAME, digest)] if digest else []
    if not manifest.is_sealed:
        return [
            *findings,
            Finding(
                NAME,
                "the run is not sealed: it is being recorded, or it crashed; then run `jbclog"
                " recover`",
            ),
        ]
    for kind in (
        cross_check(folder, manifest, head, with_report=with_report),
        _files(folder, manifest),
    ):
        findings += _first(kind)
    unreadable = [*_first(_unreadable(folder))]
    if unreadable:
        return findings + unreadable
    try:
        for kind in (
            _capture(folder, manifest),
            _ledger(folder, manifest),
            _units(folder, manifest),
            _events(folder, manifest),
            _numbers(folder, manifest),
            _clock(folder, manifest),
            _samples(folder, follows_host=manifest.clock_steps is None),
        ):
            findings += _first(kind)
        return findings
    except Exception as error:  # rows that no recorder wrote must not hide earlier findings
        return [
            *findings,
            Finding("tables", f"cannot be checked further: {unexpected_error_text(error)}"),
        ]


def _first(findings: Iterable[tuple[str, str]]) -> Iterator[Finding]:
    """Yield the first `MOST_OF_A_KIND`, and how many more there are, so that a long list does not
    hide the other kinds.
    """
    more, last = 0, NAME
    for number, (last, text) in enumerate(findings):
        if number < MOST_OF_A_KIND:
            yield Finding(last, text)
        else:
            more += 1
    if more:
        yield Finding(last, f"and {more} more findings of this kind")


def changed_files(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    """Yield the files of the manifest that differ from their sealed state, each once."""
    for listed in {file.path: file for file in manifest.files}.values():
        try:
            yield from _one_file(folder, listed)
        except (OSError, ValueError) as error:  # not ours to read; a name that no file can have
            yield Finding(listed.path, f"cannot be read: {error}")


def _files(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    yield from changed_files(folder, manifest)
    listed = Counter(file.path for file in manifest.files)
    for path, times in listed.items():
        if times > 1:
            yield Finding(NAME, f"files: lists {path} {times} times")
    yield from _unlisted(folder, listed)
    for left in live_files(folder):
        yield Finding(left.name, "is left from before sealing; `jbclog recover` removes it")


def _one_file(folder: Path, listed: SealedFile) -> Iterator[Finding]:
    path = folder / listed.path
    if path.is_symlink():
        yield Finding(listed.path, "is a link, not a file")
    elif not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
        yield Finding(listed.path, "lies outside the run's folder")
    elif not path.is_file():
        yield Finding(listed.path, "is missing")
    elif (size := path.stat().st_size) != listed.bytes:
        yield Finding(listed.path, f"has {size} bytes, the manifest says {listed.bytes}")
        yield Finding(listed.path, CHANGED)  # known without reading gigabytes
    elif sealed_file(folder, path, listed.rows).sha256 != listed.sha256:
        yield Finding(listed.path, CHANGED)


def _unlisted(folder: Path, listed: Container[str], below: str = "") -> Iterator[Finding]:
    """Yield the files and folders that the manifest should list and does not, and folders that
    cannot be listed.
    """
    try:
        inside = sorted(folder.iterdir())
    except OSError as error:
        yield Finding(below or ".", f"cannot be listed: {error.strerror or error}")
        return
    if not inside and below.removesuffix("/") not in MAY_BE_EMPTY:
        yield Finding(below, NOT_LISTED)
    live = [] if below else live_files(folder)
    for path in inside:
        name = f"{below}{path.name}"
        if path in live:
            continue
        if not is_plain_folder(path):
            if not is_later(name) and name not in listed:
                yield Finding(name, NOT_LISTED)
        elif name.count("/") == DEEPEST:
            yield Finding(f"{name}/", NOT_LISTED)
        else:
            yield from _unlisted(path, listed, f"{name}/")


def _unreadable(folder: Path) -> Iterator[Finding]:
    for table in (*TABLES, CAPTURE):
        paths = part_paths(folder, table)
        if not paths and table != CAPTURE:
            yield Finding(f"{table}/", "has no part")
        for path in paths:
            try:
                read_through(path)
            except (OSError, RecordError) as error:
                yield Finding(f"{table}/{path.name}", f"cannot be read: {error}")


def _capture(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    if manifest.wire != wire.WHOLE:
        return
    for text in wire.losses(folder):
        yield Finding(f"{CAPTURE}/", f"{text}, and the manifest says that the capture is whole")


def _ledger(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    for listed in manifest.files:
        if listed.path.endswith(OLD_CAPTURE):
            continue
        rows = _rows_in(folder / listed.path)
        if rows is not None and rows != listed.rows:
            yield Finding(listed.path, f"has {rows} rows, the manifest says {listed.rows}")
    derived = ledger_of(folder, manifest.stations)
    ours, theirs = _by_place(derived), _by_place(manifest.ledger)
    for place in sorted(ours.keys() | theirs.keys()):
        mine, said = ours.get(place), theirs.get(place)
        if mine != said:
            station, port, signal = place
            text = f"ledger, {station} port {port}: {signal}: {said}, the tables give {mine}"
            yield Finding(NAME, shortened(text, LONGEST))
    if manifest.exit_status != "lost" and manifest.lost is None:
        for facts in manifest.stations:
            yield from (Finding("samples/", text) for text in disagreements(derived, facts))


def _rows_in(path: Path) -> int | None:
    """Return the rows of a part; None for another file, or none."""
    if path.suffix == ".parquet" and path.parent.name in SCHEMAS and path.exists():
        with open_part(path) as part:
            return part.num_rows
    return None


def _by_place(ledger: Ledger) -> dict[tuple[str, str, str], object]:
    """Return the counts by station, port and signal."""
    return {
        (station, port, signal): counts
        for station, ports in ledger.items()
        for port, signals in ports.items()
        for signal, counts in signals.items()
    }


def _units(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    if fitting_units(manifest, units_of(folder)) != manifest.units:
        yield Finding(NAME, "units: differ from those in the events")


def _clock(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    """Check the steps of the host's clock, and that the run ends after its start."""
    if manifest.clock_steps is None:
        return
    if manifest.clock_steps != listed_steps(folder):
        yield Finding(NAME, "clock_steps: differ from those in the events")
    start, stop = manifest.start, manifest.stop
    if start and stop and datetime.fromisoformat(stop) < datetime.fromisoformat(start):
        yield Finding(NAME, f"stop: {stop} is before the start, {start}")


def _events(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    rows = (row for group in row_groups(folder, "events") for row in event_dicts(group))
    is_whole = not _may_lack_rows(manifest)
    for seq, text in chains.breaks(manifest.run, rows, manifest.schema, is_whole=is_whole):
        yield Finding("events/", f"event {seq} {text}")


def _may_lack_rows(manifest: Manifest) -> bool:
    """Return True if rows may be missing between others. A loss of the last seconds takes none."""
    return manifest.lost is not None and manifest.lost.seconds_at_most is None


def _numbers(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    """Check that the rows of the other tables are numbered, and that no number is missing without a
    known loss. Schema 1 has no numbers.
    """
    if manifest.schema == OLD_SCHEMA:
        return
    for table in TABLES:
        if table == NUMBERED:
            continue
        last = pa.array([-1])
        missing = out_of_order = 0
        for path in part_paths(folder, table):
            numbers = _numbers_in(path)
            if table == SORTED:  # by port, in which `_order` looks at their order
                numbers = numbers.take(pc.sort_indices(numbers))
            known = numbers.drop_null()
            steps = pc.pairwise_diff(pa.concat_arrays([last, known])).drop_null()
            rises = pc.greater(steps, 0)
            out_of_order += numbers.null_count + len(steps) - (pc.sum(rises).as_py() or 0)
            missing += pc.sum(pc.subtract(steps.filter(rises), 1)).as_py() or 0
            if len(known):
                last = known[-1:]
        if out_of_order:
            places = count_text(out_of_order, "place")
            yield Finding(f"{table}/", f"seq does not rise in {places}")
        if missing and not _may_lack_rows(manifest):
            rows = count_text(missing, "row")
            yield Finding(f"{table}/", f"{rows} missing by seq, and the manifest says no loss")


def _numbers_in(part: Path) -> pa.Array:
    """Return the numbers of a part's rows, in its order."""
    groups = [group[SEQ] for group in groups_of([part], [SEQ])]
    return pa.chunked_array([chunk for one in groups for chunk in one.chunks], INT).combine_chunks()


def _samples(folder: Path, *, follows_host: bool) -> Iterator[Finding]:
    """Check the rows. `follows_host`: their times follow the host's clock (earlier versions)."""
    stepped = any(
        pc.any(pc.equal(group["kind"], STEP)).as_py()
        for group in row_groups(folder, "events", ["kind"])
    )
    ends: dict[tuple[str, int], _Last] = {}
    for group in row_groups(folder, "samples"):
        yield from _qualities(group)
        yield from _values_with_reasons(group)
        if follows_host:
            yield from _order(group, ends, stepped=stepped, only_answered=True)
        else:
            yield from _order(group, ends, stepped=False, only_answered=False)


def _qualities(rows: pa.Table) -> Iterator[Finding]:
    for pair in rows.group_by(["quality", "reasons"]).aggregate([([], "count_all")]).to_pylist():
        reasons = dict(reasons_of(pair["reasons"])) if pair["reasons"] is not None else {}
        if pair["quality"] != quality_of(reasons):
            text = (
                f"quality {pair['quality']} contradicts reasons {pair['reasons']} in"
                f" {count_text(pair['count_all'], 'row')}"
            )
            yield Finding("samples/", shortened(text, LONGEST))
        for column in reasons.keys() - set(SIGNAL_COLUMNS):
            yield Finding(
                "samples/",
                f"a reason is given for {column}, which is not a signal, in"
                f" {count_text(pair['count_all'], 'row')}",
            )


def _values_with_reasons(rows: pa.Table) -> Iterator[Finding]:
    failed = rows.filter(pc.is_valid(rows["reasons"]))
    if not len(failed):
        return
    for column in SIGNAL_COLUMNS:
        if not failed[column].null_count < len(failed):
            continue
        named = pc.match_substring_regex(failed["reasons"], f"(^|;){column}=")
        both = pc.sum(pc.and_(named, pc.is_valid(failed[column]))).as_py() or 0
        if both:
            yield Finding(
                "samples/",
                f"both a value of {column} and a reason for its absence in"
                f" {count_text(both, 'row')}",
            )


@dataclass(slots=True)
class _Last:
    """Last tick and number of a port, and the time of its last row, or of its last answer."""

    tick: int = -1
    seq: int = -1
    time: int = 0


def _order(
    rows: pa.Table, ends: dict[tuple[str, int], _Last], *, stepped: bool, only_answered: bool
) -> Iterator[Finding]:
    """Check that ticks and numbers increase within a port, and that no time falls unless it was
    `stepped`.

    In earlier versions a row without a temperature has its due time, which can precede a late
    answer to the previous tick: `only_answered`.
    """
    known = rows.select(["station", "port", "tick", SEQ, "time", "temperature_c"])
    for (station, port), mine in split_by_port(known).items():
        last = ends.setdefault((station, port), _Last())
        timed = mine.filter(pc.is_valid(mine["temperature_c"])) if only_answered else mine
        wrong, last.tick = _falls(mine["tick"], last.tick, strictly=True)
        if wrong:
            yield Finding(
                "samples/",
                f"{station} port {port}: ticks do not rise in {count_text(wrong, 'place')}",
            )
        wrong, last.seq = _falls(mine[SEQ].drop_null(), last.seq, strictly=True)
        if wrong:
            yield Finding(
                "samples/",
                f"{station} port {port}: seq does not rise in {count_text(wrong, 'place')}",
            )
        back, last.time = _falls(timed["time"].cast(pa.int64()), last.time, strictly=False)
        if back and not stepped:
            yield Finding(
                "samples/",
                f"{station} port {port}: time goes back in {count_text(back, 'place')}"
                + (" without a step of the clock" if only_answered else ""),
            )


def _falls(values: pa.ChunkedArray, before: int, *, strictly: bool) -> tuple[int, int]:
    """Return how often a value is not above (not `strictly`: below) the previous one; and the last
    value.
    """
    numbers = pa.concat_arrays([pa.array([before], INT), *values.chunks])
    steps = pc.pairwise_diff(numbers).drop_null()
    falls = pc.less(steps, 1 if strictly else 0)
    return pc.sum(falls).as_py() or 0, numbers[-1].as_py()
