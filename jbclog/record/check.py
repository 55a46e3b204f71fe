"""Integrity check of a sealed run.

Compares the tables with the manifest, the manifest with its digest, and both with the report, the
annotations, the neighbouring runs, and a fingerprint that somebody types from a printed page.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.durable_files import lines_in, sha256
from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.core.foreign.files import Kind, open_foreign, read_foreign
from jbclog.core.foreign.json_reader import read_json
from jbclog.core.rows import SIGNAL_COLUMNS, TABLES, quality_of
from jbclog.record import capture, chains, conclude, guard_actions, report_repeats, sealed_files
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import REPORT, Annotations, read
from jbclog.record.chains import broken_links, is_head, short_head
from jbclog.record.conclude import CACHES, files_of, is_later, is_of_report, live_files, sealed_file
from jbclog.record.guard_actions import plain_events
from jbclog.record.ledger import disagreements, ledger_of, reasons_of
from jbclog.record.manifest import (
    NAME,
    Manifest,
    RunState,
    SealedFile,
    fitting_units,
    has_digest,
    manifest_sha256,
    read_manifest,
    wrong_digest,
)
from jbclog.record.parts import part_paths, read_through, row_groups
from jbclog.record.units import units_of

# Hashes inside a folder reveal accidental and hasty changes. Whoever recomputes all of them is
# revealed only by hashes kept
# elsewhere: the next run's manifest, a report, an annotation, a printed page.

AGAIN: Final = "make the report again"
MOST_OF_A_KIND: Final = 100  # findings
# of all runs of a folder (`jbclog.maintenance.verification`)
VERIFICATIONS: Final = "verifications.jsonl"


def cross_check(folder: Path, manifest: Manifest, head: str | None) -> Iterator[tuple[str, str]]:
    """Yield file and text of each disagreement with files that are not sealed, with other runs and
    with `head`.
    """
    own = manifest_sha256(folder)
    if (folder / NAME).is_symlink():
        yield NAME, "is a link, not a file"
    if head is not None and not is_head(head, own):
        yield NAME, f"its head is {short_head(own)}, not the given one"
    for text in broken_links(folder, manifest):
        yield NAME, text
    said, wrong = _annotations(folder)
    yield from ((ANNOTATIONS, text) for text in wrong)
    yield from report_disagreements(folder, manifest, said)
    yield from _lease(folder, manifest)
    yield from _guard_lock(folder)
    yield from _verifications(folder, manifest)


def uncovered(folder: Path, head: str | None) -> Iterator[tuple[str, str]]:
    """Yield file and reason for each file of a sealed run whose bytes `check` cannot vouch for; it
    covers all others.
    """
    if head is None and not has_digest(folder):
        yield NAME, "has no digest (first release): only --head reveals a change"
    if os.path.lexists(folder / guard_actions.LEASE):
        yield (
            guard_actions.LEASE,
            (
                "only its stations and ports are compared; `jbclog safe` removes it when their"
                " tools are safe"
            ),
        )
    if os.path.lexists(folder / guard_actions.LOCK):
        yield (
            guard_actions.LOCK,
            "an empty lock, as a killed guard leaves one; nothing says whose it is",
        )
    for name in CACHES:
        if os.path.lexists(folder / name):
            yield (
                name,
                (
                    "a cache, never the truth: only `jbclog trend` reads it, and `--no-cache`"
                    " computes the same from the record"
                ),
            )
    report, said = _report(folder), _annotations(folder)[0]
    if report is None:
        return
    anew = f"`jbclog report {folder}` makes the report anew"
    if said.report is None:
        yield (
            REPORT,
            f"not vouched for: no line of {ANNOTATIONS} has its hash; {anew} and adds the line",
        )
    if not report.get("written"):
        for name in _of_report(folder):
            yield name, f"not vouched for: {REPORT} has no hash of it; {anew}, with its hashes"


def _lease(folder: Path, manifest: Manifest) -> Iterator[tuple[str, str]]:
    """A lease is left only while its tools may be hot, and the manifest names the same stations; or
    its guard was killed late.
    """
    if not os.path.lexists(folder / guard_actions.LEASE):
        return
    named = conclude.left_leases(folder).keys()
    hot = {facts.name for facts in manifest.stations if facts.unsafe}
    unknown = conclude.unconfirmed_leases(folder, manifest.stations) - hot
    if not named:
        yield guard_actions.LEASE, "names no station whose tools may be hot"
    elif unknown:
        yield (
            guard_actions.LEASE,
            f"names {', '.join(sorted(unknown))} as possibly hot; the manifest does not",
        )


def _guard_lock(folder: Path) -> Iterator[tuple[str, str]]:
    """A killed guard can leave its lock behind, an empty file."""
    try:
        found = (folder / guard_actions.LOCK).lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISREG(found.st_mode):
        yield guard_actions.LOCK, "is not a regular file; no guard leaves that"
    elif found.st_size:
        yield guard_actions.LOCK, f"has {found.st_size} bytes; a guard leaves an empty file"


def _verifications(folder: Path, manifest: Manifest) -> Iterator[tuple[str, str]]:
    """Each verification that the manifest cites is a line of the file beside the run, if any."""
    cited = {
        one.sha256: f"{one.station} port {one.port}"
        for one in reversed(manifest.verifications)
        if one.sha256 is not None
    }
    path = folder.absolute().parent / VERIFICATIONS
    if not cited:
        return
    try:
        lines = {sha256(line) for line in lines_in(read_foreign(path, Kind.VERIFICATIONS))}
    except FileNotFoundError:
        return  # the run was moved
    except OSError as error:
        yield f"../{VERIFICATIONS}", f"cannot be read: {error.strerror or error}"
        return
    for place in (place for line, place in cited.items() if line not in lines):
        yield (
            f"../{VERIFICATIONS}",
            f"lacks the line that this run cites ({place}): changed or removed",
        )


def report_disagreements(
    folder: Path, manifest: Manifest, said: Annotations
) -> Iterator[tuple[str, str]]:
    """Yield file and text of each disagreement between the report, its files, the manifest and the
    annotations.

    The report names the manifest and the annotations that it was made from and the hash of each
    file written with it. A line of the annotations holds the report's own hash.
    """
    own, made = manifest_sha256(folder), _of_report(folder)
    if not os.path.lexists(folder / REPORT):
        yield from ((name, f"has no {REPORT} to vouch for it; {AGAIN}") for name in made)
        if said.report is not None:
            yield REPORT, f"is missing, although {ANNOTATIONS} records it; {AGAIN}"
        return
    report = _report(folder)
    if report is None:
        yield REPORT, "is not a run's report"
        return
    if report["manifest_sha256"] != own:
        text = (
            f"was made from manifest {short_head(str(report['manifest_sha256']))}, not from this"
            f" one, {short_head(own)}"
        )
        yield REPORT, text
    if said.report is not None and _sha256(folder / REPORT) != said.report:
        yield REPORT, f"was changed: its SHA-256 differs from the one in {ANNOTATIONS}; {AGAIN}"
    if said.report is None and "vouched_in" in report:
        yield REPORT, f"cites a line of {ANNOTATIONS} that is gone; {AGAIN}"
    if report["manifest_sha256"] == own:
        yield from _unlike(report, manifest, said, own)
    if report.get("written"):  # the first release wrote none
        yield from _report_files(folder, report["written"], {*made})


def _report(folder: Path) -> dict[str, Any] | None:
    """Return the report's facts; None without a report or where the file is not one."""
    try:
        report = read_json(folder / REPORT, Kind.REPORT)
        fits = isinstance(report["manifest_sha256"], str) and isinstance(
            report.get("written", {}), dict
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None
    return cast("dict[str, Any]", report) if fits else None


def _of_report(folder: Path) -> list[str]:
    """Return the names of the report's files in the folder, without `report.json`."""
    there = (path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir())
    names = (path.relative_to(folder).as_posix() for path in there)
    return sorted(name for name in names if is_of_report(name) and name != REPORT)


def _unlike(
    report: Mapping[str, Any], manifest: Manifest, said: Annotations, own: str
) -> Iterator[tuple[str, str]]:
    """Yield where this manifest's report contradicts the manifest or the annotations."""
    if said.links and str(report.get("annotations_head", own)) not in said.links:
        yield (
            ANNOTATIONS,
            f"lacks the line that was last when {REPORT} was made: lines were changed or removed",
        )
    try:
        yield from (
            (REPORT, text) for text in report_repeats.differences(report, manifest, said, own)
        )
    except (TypeError, ValueError, AttributeError, LookupError, RecursionError) as error:
        yield REPORT, f"cannot be compared further: {unexpected_error_text(error)}"


def _report_files(
    folder: Path, hashes: Mapping[str, object], made: set[str]
) -> Iterator[tuple[str, str]]:
    for name in sorted(made - {*hashes}):
        yield name, f"was not written with {REPORT}; {AGAIN}"
    for name in sorted({*hashes} - made):
        yield str(name), f"was written with {REPORT} and is missing; {AGAIN}"
    for name in sorted(made & {*hashes}):
        if _sha256(folder / name) != hashes[name]:
            yield name, f"was changed since {REPORT} was written; {AGAIN}"


def _sha256(path: Path) -> str:
    """Return the SHA-256 of a file; a text, which no hash equals, where it cannot be read."""
    try:
        with open_foreign(path, Kind.OF_REPORT) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        return f"not known: {error}"


def _annotations(folder: Path) -> tuple[Annotations, list[str]]:
    """Return the annotations and the problems of their file."""
    try:
        found = read(folder)
    except RecordError as error:
        return Annotations(), [str(error)]
    return found, [f"line {number} {text}" for number, text in found.wrong]


# a crash at the start, or a report, leaves them so
MAY_BE_EMPTY: Final = ("recipes", capture.FOLDER, "figures", "tables")


class Finding(NamedTuple):
    """A disagreement, and the file that shows it."""

    file: str
    text: str

    def __str__(self) -> str:
        return f"{self.file}: {self.text}"


def check(folder: Path, head: str | None = None) -> list[Finding]:
    """Return every disagreement within the run. Raises `RecordError` where the folder is not a run.

    `head` is an earlier fingerprint of the run, as a report shows it.
    """
    manifest = read_manifest(folder)
    digest = wrong_digest(folder)
    findings = [Finding(NAME, digest)] if digest else []
    if manifest.state != RunState.SEALED:
        return [
            *findings,
            Finding(
                NAME,
                "the run is not sealed: it is being recorded, or it crashed; then run `jbclog"
                " recover`",
            ),
        ]
    for kind in (
        cross_check(folder, manifest, head),
        _files(folder, manifest),
        _wires(folder, manifest),
    ):
        findings += _first(kind)
    unreadable = [*_first(_unreadable(folder, manifest))]
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
    except Exception as error:  # rows that no recorder wrote must not hide the findings so far
        return [
            *findings,
            Finding("tables", f"cannot be checked further: {unexpected_error_text(error)}"),
        ]


def _first(findings: Iterable[tuple[str, str]]) -> Iterator[Finding]:
    """Yield the first `MOST_OF_A_KIND`, and how many more there are: a list that somebody made must
    not hide the other kinds.
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
    """Yield the files of the manifest that differ from what was sealed, each once."""
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
    for file in _there(folder):
        if file not in listed:
            yield Finding(file, "is not in the manifest")
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
    else:
        found = sealed_file(folder, path, listed.rows)
        if found.bytes != listed.bytes:
            yield Finding(listed.path, f"has {found.bytes} bytes, the manifest {listed.bytes}")
        if found.sha256 != listed.sha256:
            yield Finding(listed.path, "was changed: its SHA-256 is not the manifest's")


def _there(folder: Path, below: str = "") -> Iterator[str]:
    """Yield the names of files and folders that the manifest should list."""
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
        return []  # the files listed below it are reported as unreadable


def _is_empty(folder: Path) -> bool:
    """Whether the folder is empty; False where it cannot be read."""
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
            yield Finding(found.path, f"has {found.rows} rows, the manifest {rows[found.path]}")
    derived = ledger_of(folder, manifest.stations)
    for station in sorted(derived.keys() | manifest.ledger.keys()):
        ours, theirs = derived.get(station, {}), manifest.ledger.get(station, {})
        for port in sorted(ours.keys() | theirs.keys()):
            mine, said = ours.get(port, {}), theirs.get(port, {})
            for signal in sorted(mine.keys() | said.keys()):
                if mine.get(signal) != said.get(signal):
                    text = (
                        f"ledger, {station} port {port}: {signal}: {said.get(signal)}, the tables"
                        f" give {mine.get(signal)}"
                    )
                    yield Finding(NAME, text)
    if manifest.exit_status != "lost" and manifest.lost is None:
        for facts in manifest.stations:
            yield from (Finding("samples/", text) for text in disagreements(derived, facts))


def _units(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    if fitting_units(manifest, units_of(folder)) != manifest.units:
        yield Finding(NAME, "units: differ from those in the events")


def _events(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    rows = (
        row for group in row_groups(folder, "events") for row in plain_events(group).to_pylist()
    )
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
                f"{pair['count_all']} rows have quality {pair['quality']} with reasons"
                f" {pair['reasons']}"
            )
            yield Finding("samples/", text)
        for column in reasons.keys() - set(SIGNAL_COLUMNS):
            yield Finding(
                "samples/",
                f"{pair['count_all']} rows give a reason for {column}, which is not a signal",
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
                f"{both} rows have both a value of {column} and a reason for its absence",
            )


@dataclass(slots=True)
class _Last:
    """The last tick of a port, and the time of its last answer."""

    tick: int = -1
    time: int = 0


def _order(rows: pa.Table, ends: dict[tuple[str, int], _Last], stepped: bool) -> Iterator[Finding]:
    """Check that ticks rise within a port, and with them the times of answers unless the clock was
    stepped.

    A row without a temperature has its due time, which can precede a late answer to the previous
    tick.
    """
    for pair in rows.group_by(["station", "port"]).aggregate([]).to_pylist():
        station, port = pair["station"], pair["port"]
        last = ends.setdefault((station, port), _Last())
        mine = rows.filter(
            pc.and_(pc.equal(rows["station"], station), pc.equal(rows["port"], port))
        )
        answered = mine.filter(pc.is_valid(mine["temperature_c"]))
        wrong, last.tick = _falls(mine["tick"], last.tick, strictly=True)
        if wrong:
            yield Finding("samples/", f"{station} port {port}: ticks do not rise in {wrong} places")
        back, last.time = _falls(answered["time"].cast(pa.int64()), last.time, strictly=False)
        if back and not stepped:
            yield Finding(
                "samples/",
                f"{station} port {port}: time goes back in {back} places without a step of the"
                " clock",
            )


def _falls(values: pa.ChunkedArray, before: int, *, strictly: bool) -> tuple[int, int]:
    """Return how often a value is not above (not `strictly`: below) the last; and the last."""
    numbers = [before, *values.to_pylist()]
    falls = sum(one >= two if strictly else one > two for one, two in pairwise(numbers))
    return falls, numbers[-1]
