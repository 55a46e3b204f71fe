"""Integrity check of a sealed run: compare its files and tables with the manifest, and run
`cross_check`.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.core.files import DEEPEST, is_plain_folder
from jbclog.core.rows import SIGNAL_COLUMNS, TABLES, quality_of
from jbclog.core.text import count_text, shortened
from jbclog.record import capture, chains, sealed_files
from jbclog.record.conclude import files_of, is_later, live_files, sealed_file
from jbclog.record.cross_check import cross_check
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
from jbclog.record.part_file import CHANGED
from jbclog.record.parts import part_paths, read_through, row_groups
from jbclog.record.units import units_of

NOT_LISTED: Final = "is not in the manifest"
MOST_OF_A_KIND: Final = 100  # findings
LONGEST: Final = 2000  # characters of a finding that repeats text of the tables
# a crash at the start, or a report, leaves them empty
MAY_BE_EMPTY: Final = ("recipes", capture.FOLDER, "figures", "tables")


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
        _wires(folder, manifest),
    ):
        findings += _first(kind)
    unreadable = [*_first(_unreadable(folder))]
    if unreadable:
        return findings + unreadable
    try:
        for kind in (
            _ledger(folder, manifest),
            _units(folder, manifest),
            _events(folder, manifest),
            _samples(folder),
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
    for table in TABLES:
        if not part_paths(folder, table):
            yield Finding(f"{table}/", "has no part")
        for path in part_paths(folder, table):
            try:
                read_through(path)
            except (OSError, RecordError) as error:
                yield Finding(f"{table}/{path.name}", f"cannot be read: {error}")


def _wires(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    for path in capture.wire_paths(folder):
        name = path.relative_to(folder).as_posix()
        try:
            yield from (Finding(name, text) for text in sealed_files.losses(path))
            if manifest.wire == capture.WHOLE and sealed_files.ends_early(path):
                yield Finding(
                    name, "ends before its session, although the manifest says that it is whole"
                )
        except OSError as error:
            yield Finding(name, f"cannot be read: {error.strerror or error}")


def _ledger(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    rows = {file.path: file.rows for file in manifest.files}
    for found in files_of(folder):
        if found.rows != rows.get(found.path, found.rows):
            yield Finding(
                found.path, f"has {found.rows} rows, the manifest says {rows[found.path]}"
            )
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


def _events(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    rows = (row for group in row_groups(folder, "events") for row in event_dicts(group))
    for seq, text in chains.breaks(manifest.run, rows):
        yield Finding("events/", f"event {seq} {text}")


def _samples(folder: Path) -> Iterator[Finding]:
    stepped = any(
        pc.any(pc.equal(group["kind"], "clock.step")).as_py()
        for group in row_groups(folder, "events", ["kind"])
    )
    ends: dict[tuple[str, int], _Last] = {}
    for group in row_groups(folder, "samples"):
        yield from _qualities(group)
        yield from _values_with_reasons(group)
        yield from _order(group, ends, stepped)


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
    """Last tick of a port, and the time of its last answer."""

    tick: int = -1
    time: int = 0


def _order(rows: pa.Table, ends: dict[tuple[str, int], _Last], stepped: bool) -> Iterator[Finding]:
    """Check that ticks increase within a port, and so do the times of answers unless the clock was
    stepped.

    A row without a temperature has its due time, which can precede a late answer to the previous
    tick.
    """
    known = rows.select(["station", "port", "tick", "time", "temperature_c"])
    places = [("station", "ascending"), ("port", "ascending")]
    ordered = known.take(pc.sort_indices(known, sort_keys=places))  # keeps the order within a port
    counted = ordered.group_by(["station", "port"], use_threads=False)
    begin = 0
    for pair in counted.aggregate([([], "count_all")]).to_pylist():
        station, port, count = pair["station"], pair["port"], pair["count_all"]
        last = ends.setdefault((station, port), _Last())
        mine, begin = ordered.slice(begin, count), begin + count
        answered = mine.filter(pc.is_valid(mine["temperature_c"]))
        wrong, last.tick = _falls(mine["tick"], last.tick, strictly=True)
        if wrong:
            yield Finding(
                "samples/",
                f"{station} port {port}: ticks do not rise in {count_text(wrong, 'place')}",
            )
        back, last.time = _falls(answered["time"].cast(pa.int64()), last.time, strictly=False)
        if back and not stepped:
            yield Finding(
                "samples/",
                f"{station} port {port}: time goes back in {count_text(back, 'place')} without a"
                " step of the clock",
            )


def _falls(values: pa.ChunkedArray, before: int, *, strictly: bool) -> tuple[int, int]:
    """Return how often a value is not above (not `strictly`: below) the previous one; and the last
    value.
    """
    numbers = [before, *values.to_pylist()]
    falls = sum(one >= two if strictly else one > two for one, two in pairwise(numbers))
    return falls, numbers[-1]
