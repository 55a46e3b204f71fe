"""What a sealed run says of itself, held against what others say of it.

Hashes inside a folder show what was changed by accident or in haste. Who writes all of them anew is shown by what
stands elsewhere: the next run's manifest, a report, an annotation, a printed page.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, cast

from jbclog.core.durable_files import lines_in, sha256
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, open_foreign, read_foreign
from jbclog.core.foreign.json_reader import read_json
from jbclog.record import guard_actions, left_hot
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import REPORT, Annotations, read
from jbclog.record.conclude import is_of_report
from jbclog.record.manifest import NAME, Manifest, has_digest, manifest_sha256
from jbclog.record.run_chain import broken_links, is_head, short_head

AGAIN: Final = "make the report again"
SAME: Final = ("run", "state", "exit_status", "exit_code", "started", "ended")  # keys of report and manifest
VERIFICATIONS: Final = "verifications.jsonl"  # of all runs of a folder (`verifying`)


def disagreements(folder: Path, manifest: Manifest, head: str | None) -> Iterator[tuple[str, str]]:
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
    named = left_hot.leases(folder).keys()
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
        yield from _files(folder, report["written"], {*made})


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


def _files(folder: Path, told: Mapping[str, object], made: set[str]) -> Iterator[tuple[str, str]]:
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
