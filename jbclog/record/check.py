"""Checks a sealed run: against its manifest, and against what others say of it.

What is inside is held against the manifest, the manifest against its digest, and both against what stands elsewhere:
the report, the annotations, the runs before and behind it, and the head that somebody types off a printed page.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, cast

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.durable_files import lines_in, sha256
from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.core.foreign.files import Kind, open_foreign, read_foreign
from jbclog.core.foreign.json_reader import read_json
from jbclog.core.rows import SIGNAL_COLUMNS, quality_of
from jbclog.record import capture, chains, conclude, guard_actions, sealed_files
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import REPORT, Annotations, read, units_of
from jbclog.record.chains import broken_links, is_head, short_head
from jbclog.record.conclude import files_of, is_later, is_of_report, live_files, sealed_file
from jbclog.record.guard_actions import plain_events
from jbclog.record.ledger import disagreements, ledger_of, reasons_of
from jbclog.record.manifest import NAME, Manifest, SealedFile, has_digest, manifest_sha256, read_manifest, wrong_digest
from jbclog.record.parts import part_paths, read_through, row_groups
from jbclog.record.schema import TABLES

# -- cross check --------------------------------------------------------------------------------------------------------------
# What a sealed run says of itself, held against what others say of it.
#
# Hashes inside a folder show what was changed by accident or in haste. Who writes all of them anew is shown by what
# stands elsewhere: the next run's manifest, a report, an annotation, a printed page.

AGAIN: Final = "make the report again"
SAME: Final = ("run", "state", "exit_status", "exit_code", "started", "ended")  # keys of report and manifest
VERIFICATIONS: Final = "verifications.jsonl"  # of all runs of a folder (`verifying`)


def cross_check(folder: Path, manifest: Manifest, head: str | None) -> Iterator[tuple[str, str]]:
    """File and sentence for each."""
    own = manifest_sha256(folder)
    if (folder / NAME).is_symlink():
        yield NAME, "is a link, not a file"
    if head is not None and not is_head(head, own):
        yield NAME, f"is not the one that was told: its head is {short_head(own)}"
    for text in broken_links(folder, manifest):
        yield NAME, text
    said, wrong = _annotations(folder)
    yield from ((ANNOTATIONS, text) for text in wrong)
    yield from report_disagreements(folder, manifest, said)
    yield from _lease(folder, manifest)
    yield from _guard_lock(folder)
    yield from _verifications(folder, manifest)


def uncovered(folder: Path, head: str | None) -> Iterator[tuple[str, str]]:
    """File and sentence for each file of a sealed run whose bytes nothing here vouches for; all others are covered by `check`."""
    if head is None and not has_digest(folder):
        yield NAME, "has no digest, as those of the first release: a change of it shows only where its head is given (--head)"
    if os.path.lexists(folder / guard_actions.LEASE):
        yield guard_actions.LEASE, "only the names of its stations are compared; `jbclog safe` removes it when their tools are safe"
    report, said = _report(folder), _annotations(folder)[0]
    if report is None:
        return
    if said.report is None:
        yield REPORT, f"not vouched for: no line of {ANNOTATIONS} has its hash; `jbclog report {folder}` writes one that has"
    if not report.get("written"):
        for name in _of_report(folder):
            yield name, f"not vouched for: {REPORT} has no hash of it; `jbclog report {folder}` writes one that has"


def _lease(folder: Path, manifest: Manifest) -> Iterator[tuple[str, str]]:
    """It is there only while tools that it names may be hot, and then the manifest says so, too."""
    if not os.path.lexists(folder / guard_actions.LEASE):
        return
    named = conclude.left_leases(folder).keys()
    unknown = named - {facts.name for facts in manifest.stations if facts.unsafe}
    if not named:
        yield guard_actions.LEASE, "is there, and says of no station that its tools may be hot"
    elif unknown:
        yield guard_actions.LEASE, f"says that tools of {', '.join(sorted(unknown))} may be hot, and the manifest does not"


def _guard_lock(folder: Path) -> Iterator[tuple[str, str]]:
    """It may be left behind by a guard that was killed, and is an empty file."""
    try:
        found = (folder / guard_actions.LOCK).lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISREG(found.st_mode):
        yield guard_actions.LOCK, "is no file; no guard leaves that"
    elif found.st_size:
        yield guard_actions.LOCK, f"has {found.st_size} bytes; a guard leaves an empty one"


def _verifications(folder: Path, manifest: Manifest) -> Iterator[tuple[str, str]]:
    """Each verification that the run was begun on is a line of the file beside it, where that is there; told once for all ports."""
    cited = {one.sha256: f"{one.station} port {one.port}" for one in reversed(manifest.verifications) if one.sha256 is not None}
    path = folder.absolute().parent / VERIFICATIONS
    if not cited:
        return
    try:
        lines = {sha256(line) for line in lines_in(read_foreign(path, Kind.VERIFICATIONS))}
    except FileNotFoundError:
        return  # the run was taken elsewhere
    except OSError as error:
        yield f"../{VERIFICATIONS}", f"cannot be read: {error.strerror or error}"
        return
    for place in (place for line, place in cited.items() if line not in lines):
        yield f"../{VERIFICATIONS}", f"has not the line that this run was begun on ({place}): it was changed, or is gone"


def report_disagreements(folder: Path, manifest: Manifest, said: Annotations) -> Iterator[tuple[str, str]]:
    """File and sentence for each.

    The report names the manifest that it was made from, what was said then, and the hash of each file that was written with it.
    A line of the annotations has its own hash.
    """
    own, made = manifest_sha256(folder), _of_report(folder)
    if not os.path.lexists(folder / REPORT):
        yield from ((name, f"stands without {REPORT}, which would vouch for it; {AGAIN}") for name in made)
        if said.report is not None:
            yield REPORT, f"is missing: {ANNOTATIONS} says that it was written; {AGAIN}"
        return
    report = _report(folder)
    if report is None:
        yield REPORT, "is no report of a run"
        return
    if report["manifest_sha256"] != own:
        text = f"was made from another manifest: {short_head(str(report['manifest_sha256']))}, this one is {short_head(own)}"
        yield REPORT, text
    if said.report is not None and _sha256(folder / REPORT) != said.report:
        yield REPORT, f"was changed: its SHA-256 is not the one in {ANNOTATIONS}; {AGAIN}"
    if said.report is None and "vouched_in" in report:
        yield REPORT, f"is vouched for by a line of {ANNOTATIONS}, and that line is gone; {AGAIN}"
    if report["manifest_sha256"] == own:
        yield from _unlike(report, manifest, said, own)
    if report.get("written"):  # reports of before had none
        yield from _report_files(folder, report["written"], {*made})


def _report(folder: Path) -> dict[str, Any] | None:
    """The report's facts; None where there is no report, or what is there is none."""
    try:
        report = read_json(folder / REPORT, Kind.REPORT)
        fits = isinstance(report["manifest_sha256"], str) and isinstance(report.get("written", {}), dict)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None
    return cast("dict[str, Any]", report) if fits else None


def _of_report(folder: Path) -> list[str]:
    """What lies there under a name of a report's files, beside `report.json`."""
    there = (path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir())
    names = (path.relative_to(folder).as_posix() for path in there)
    return sorted(name for name in names if is_of_report(name) and name != REPORT)


def _unlike(report: Mapping[str, Any], manifest: Manifest, said: Annotations, own: str) -> Iterator[tuple[str, str]]:
    """Where a report of this manifest says another thing than manifest or annotations, which it says once more."""
    if said.links and str(report.get("annotations_head", own)) not in said.links:
        yield ANNOTATIONS, f"has not the line that was the last when {REPORT} was made: lines were changed or taken away"
    for key in SAME:
        if key in report and report[key] != getattr(manifest, key):
            yield REPORT, f"{key}: {report[key]!s:.80}, the manifest says {getattr(manifest, key)}"
    verdict = report.get("verdict")
    word = verdict.get("word") if isinstance(verdict, dict) else verdict
    if manifest.verdict is not None and "verdict" in report and word != manifest.verdict:
        yield REPORT, f"verdict: {word!s:.80}, the manifest says {manifest.verdict}"


def _report_files(folder: Path, told: Mapping[str, object], made: set[str]) -> Iterator[tuple[str, str]]:
    for name in sorted(made - {*told}):
        yield name, f"was not written with {REPORT}; {AGAIN}"
    for name in sorted({*told} - made):
        yield str(name), f"was written with {REPORT} and is missing; {AGAIN}"
    for name in sorted(made & {*told}):
        if _sha256(folder / name) != told[name]:
            yield name, f"was changed since {REPORT} was written; {AGAIN}"


def _sha256(path: Path) -> str:
    """In words where it cannot be read: that is no hash, and so differs."""
    try:
        with open_foreign(path, Kind.OF_REPORT) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        return f"not known: {error}"


def _annotations(folder: Path) -> tuple[Annotations, list[str]]:
    """What was said, and what is wrong with it, a sentence each."""
    try:
        found = read(folder)
    except RecordError as error:
        return Annotations(), [str(error)]
    return found, [f"line {number} {text}" for number, text in found.wrong]


# -- check --------------------------------------------------------------------------------------------------------------------

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
    findings += [Finding(file, text) for file, text in cross_check(folder, manifest, head)]
    findings += _files(folder, manifest)
    findings += _wires(folder, manifest)
    unreadable = [*_unreadable(folder, manifest)]
    if unreadable:
        return findings + unreadable  # what cannot be read cannot be checked further
    try:
        return [*findings, *_ledger(folder, manifest), *_units(folder, manifest), *_events(folder, manifest), *_samples(folder)]
    except Exception as error:  # rows that no recorder wrote; what was found so far must not be lost over them
        return [*findings, Finding("tables", f"cannot be checked further: {unexpected_error_text(error)}")]


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
            yield from (Finding(name, text) for text in sealed_files.losses(path))
            if manifest.wire == capture.WHOLE and sealed_files.ends_early(path):
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
    for seq, text in chains.breaks(manifest.run, rows):
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
