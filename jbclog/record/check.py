"""Looks at a sealed run as if it did not believe a word of its manifest, and says what does not agree.

What is inside is held against the manifest, the manifest against its digest, and both against what stands elsewhere:
the report, the annotations, the runs before and behind it, and the head that somebody types off a printed page.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.errors import RecordError
from jbclog.core.rows import SIGNAL_COLUMNS, quality_of
from jbclog.record import capture, capture_check, chain, cross_check
from jbclog.record.conclude import files_of, is_later, live_files, sealed_file
from jbclog.record.guard_actions import plain_events
from jbclog.record.ledger import disagreements, ledger_of, reasons_of
from jbclog.record.manifest import NAME, Manifest, SealedFile, read_manifest, wrong_digest
from jbclog.record.parts import part_paths, read_through, row_groups
from jbclog.record.schema import TABLES
from jbclog.record.units import units_of

MAY_BE_EMPTY: Final = ("recipes", capture.FOLDER, "figures", "tables")  # a crash at the start, or a report, leaves them so


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that does not agree, and the file that shows it."""

    file: str
    text: str

    def __str__(self) -> str:
        return f"{self.file}: {self.text}"


def check(folder: Path, head: str | None = None) -> list[Finding]:
    """Everything in the run that does not agree with itself; nothing where all is well. Raises `RecordError` where it is no run.

    `head` is what the run's head was once, as a report shows it.
    """
    manifest = read_manifest(folder)
    digest = wrong_digest(folder)
    findings = [Finding(NAME, digest)] if digest else []
    if manifest.state != "sealed":
        return [*findings, Finding(NAME, "the run is not sealed: it is being recorded, or a crash cut it off; then recover it")]
    findings += [Finding(file, text) for file, text in cross_check.disagreements(folder, manifest, head)]
    findings += _files(folder, manifest)
    findings += _wires(folder, manifest)
    unreadable = [*_unreadable(folder, manifest)]
    if unreadable:
        return findings + unreadable  # what cannot be read cannot be checked further
    try:
        return [*findings, *_ledger(folder, manifest), *_units(folder, manifest), *_events(folder, manifest), *_samples(folder)]
    except Exception as error:  # rows that no recorder wrote; what was found so far must not be lost over them
        return [*findings, Finding("tables", f"cannot be checked further: {type(error).__name__}: {error}")]


# -- files -----------------------------------------------------------------------------------------------------------


def changed_files(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    """Which files of the manifest are not, byte for byte, what was sealed."""
    for listed in manifest.files:
        try:
            yield from _one_file(folder, listed)
        except (OSError, ValueError) as error:  # not ours to read; a name that no file can have
            yield Finding(listed.path, f"cannot be read: {error}")


def _files(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    yield from changed_files(folder, manifest)
    listed_paths = {file.path for file in manifest.files}
    for file in _there(folder):
        if file not in listed_paths:
            yield Finding(file, "is in the folder and not in the manifest")
    for path in live_files(folder):
        yield Finding(path.name, "is left of the time before sealing; recover the run to remove it")


def _one_file(folder: Path, listed: SealedFile) -> Iterator[Finding]:
    path = folder / listed.path
    if path.is_symlink():
        yield Finding(listed.path, "is a link, not a file")
    elif not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
        yield Finding(listed.path, "lies outside the run's folder")
    elif not path.is_file():
        yield Finding(listed.path, "is missing")
    else:
        found = sealed_file(folder, path, listed.rows)
        if found.bytes != listed.bytes:
            yield Finding(listed.path, f"has {found.bytes} bytes, the manifest says {listed.bytes}")
        if found.sha256 != listed.sha256:
            yield Finding(listed.path, "was changed: its SHA-256 is not the manifest's")


def _there(folder: Path, below: str = "") -> Iterator[str]:
    """What lies in the folder and ought to be in the manifest."""
    live = [] if below else live_files(folder)
    for path in _inside(folder):
        name = f"{below}{path.name}"
        if path in live:
            continue
        if not path.is_dir() or path.is_symlink():
            if not is_later(name):
                yield name
        elif _is_empty(path) and name not in MAY_BE_EMPTY:
            yield f"{name}/"
        else:
            yield from _there(path, f"{name}/")


def _inside(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except PermissionError:
        return []  # what is listed below it is told as unreadable


def _is_empty(folder: Path) -> bool:
    """Whether there is nothing in it; of one that nobody lets us look into that is not known."""
    try:
        return not any(folder.iterdir())
    except PermissionError:
        return False


def _unreadable(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    rows = {file.path: file.rows for file in manifest.files}
    for table in TABLES:
        if not part_paths(folder, table):
            yield Finding(f"{table}/", "has no part")
        for path in part_paths(folder, table):
            try:
                read_through(path, rows.get(f"{table}/{path.name}"))
            except (pa.ArrowException, OSError, RecordError) as error:
                yield Finding(f"{table}/{path.name}", f"cannot be read: {error}")


# -- the wires ----------------------------------------------------------------------------------------------------------


def _wires(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    for path in capture.wire_paths(folder):
        name = path.relative_to(folder).as_posix()
        try:
            yield from (Finding(name, text) for text in capture_check.losses(path))
            if manifest.wire == capture.WHOLE and capture_check.ends_early(path):
                yield Finding(name, "ends before its session did, and the manifest says that it is whole")
        except OSError as error:
            yield Finding(name, f"cannot be read: {error.strerror or error}")


# -- the ledger -------------------------------------------------------------------------------------------------------


def _ledger(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    rows = {file.path: file.rows for file in manifest.files}
    for found in files_of(folder):
        if found.rows != rows.get(found.path, found.rows):
            yield Finding(found.path, f"has {found.rows} rows, the manifest says {rows[found.path]}")
    derived = ledger_of(folder, manifest.stations)
    for station in sorted(derived.keys() | manifest.ledger.keys()):
        ours, theirs = derived.get(station, {}), manifest.ledger.get(station, {})
        for port in sorted(ours.keys() | theirs.keys()):
            mine, said = ours.get(port, {}), theirs.get(port, {})
            for signal in sorted(mine.keys() | said.keys()):
                if mine.get(signal) != said.get(signal):
                    text = f"ledger, {station} port {port}: {signal}: {said.get(signal)}, the tables give {mine.get(signal)}"
                    yield Finding(NAME, text)
    if manifest.exit_status != "lost" and manifest.lost is None:
        for facts in manifest.stations:
            yield from (Finding("samples/", text) for text in disagreements(derived, facts))


def _units(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    if units_of(folder) != manifest.units:
        yield Finding(NAME, "units: not those that the events tell of")


# -- events -----------------------------------------------------------------------------------------------------------


def _events(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    rows = (row for group in row_groups(folder, "events") for row in plain_events(group).to_pylist())
    for seq, text in chain.breaks(manifest.run, rows):
        yield Finding("events/", f"event {seq} {text}")


# -- samples ----------------------------------------------------------------------------------------------------------


def _samples(folder: Path) -> Iterator[Finding]:
    stepped = any(pc.any(pc.equal(group["kind"], "clock.step")).as_py() for group in row_groups(folder, "events", ["kind"]))
    ends: dict[tuple[str, int], _Last] = {}
    for group in row_groups(folder, "samples"):
        yield from _qualities(group)
        yield from _values_with_reasons(group)
        yield from _order(group, ends, stepped)


def _qualities(rows: pa.Table) -> Iterator[Finding]:
    for pair in rows.group_by(["quality", "reasons"]).aggregate([([], "count_all")]).to_pylist():
        reasons = dict(reasons_of(pair["reasons"])) if pair["reasons"] is not None else {}
        if pair["quality"] != quality_of(reasons):
            text = f"{pair['count_all']} rows have quality {pair['quality']} with reasons {pair['reasons']}"
            yield Finding("samples/", text)
        for column in reasons.keys() - set(SIGNAL_COLUMNS):
            yield Finding("samples/", f"{pair['count_all']} rows give a reason for {column}, which is no signal")


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
            yield Finding("samples/", f"{both} rows have a value of {column} and a reason why there is none")


@dataclass(slots=True)
class _Last:
    """The last tick, and the last time of an answer, of one port."""

    tick: int = -1
    time: int = 0


def _order(rows: pa.Table, ends: dict[tuple[str, int], _Last], stepped: bool) -> Iterator[Finding]:
    """Ticks rise by port, and with them the times of the answers, unless the clock was stepped.

    Rows without a temperature have their due time, which may lie before a late answer to the tick before.
    """
    for pair in rows.group_by(["station", "port"]).aggregate([]).to_pylist():
        station, port = pair["station"], pair["port"]
        last = ends.setdefault((station, port), _Last())
        mine = rows.filter(pc.and_(pc.equal(rows["station"], station), pc.equal(rows["port"], port)))
        answered = mine.filter(pc.is_valid(mine["temperature_c"]))
        wrong, last.tick = _falls(mine["tick"], last.tick, strictly=True)
        if wrong:
            yield Finding("samples/", f"{station} port {port}: the tick does not rise in {wrong} places")
        back, last.time = _falls(answered["time"].cast(pa.int64()), last.time, strictly=False)
        if back and not stepped:
            yield Finding("samples/", f"{station} port {port}: the time goes back in {back} places, and no clock was stepped")


def _falls(values: pa.ChunkedArray, before: int, *, strictly: bool) -> tuple[int, int]:
    """How often a value is not above (not `strictly`: is below) the one before it, and the last value."""
    numbers = [before, *values.to_pylist()]
    falls = sum(one >= two if strictly else one > two for one, two in pairwise(numbers))
    return falls, numbers[-1]
