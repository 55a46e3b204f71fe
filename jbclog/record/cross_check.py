"""Compare the manifest of a sealed run with unsealed sources: the report, the annotations, the
neighbouring runs, and a fingerprint typed from a printed page.

Hashes inside a folder show damage and hasty changes. A folder whose hashes were all computed again
shows only by hashes kept elsewhere: the next run's manifest, a report, an annotation, a printed
page.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, cast

from jbclog.core.chain import sha256
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, is_plain_folder, open_regular, read_regular
from jbclog.core.json_files import read_json
from jbclog.record import conclude, guard_actions
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import REPORT, Annotations, read
from jbclog.record.chains import broken_links, is_head, short_head
from jbclog.record.conclude import DERIVED_FILES, MADE, OF_EARLIER, UNFINISHED, is_of_report
from jbclog.record.manifest import NAME, Manifest, has_digest, manifest_sha256

AGAIN: Final = "make the report again"
# of all runs of a folder (`jbclog.maintenance.verification`)
VERIFICATIONS: Final = "verifications.jsonl"
NOT_VOUCHED_FOR: Final = {
    guard_actions.LEASE: (
        "only its stations and ports are compared; `jbclog safe` removes it when their tools are"
        " safe"
    ),
    guard_actions.LOCK: "an empty lock, as a killed guard leaves one; nothing says whose it is",
    **dict.fromkeys(UNFINISHED, "its writer was killed; nothing reads it"),
}
DERIVED: Final = {
    **dict.fromkeys(
        DERIVED_FILES,
        "derived from the record, never the truth: `jbclog report` makes it anew, with its hash in"
        f" {REPORT}",
    ),
    **dict.fromkeys(OF_EARLIER, "of an earlier version; nothing reads it"),
}
"""Derived tables, and why a report that does not name one does not cover it."""


def cross_check(
    folder: Path, manifest: Manifest, head: str | None, *, with_report: bool = True
) -> Iterator[tuple[str, str]]:
    """Yield file and text of each disagreement with unsealed files, with other runs and with
    `head`; `with_report`: with the report, too.
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
    if with_report:
        yield from _report_disagreements(folder, said)
    yield from _lease(folder, manifest)
    yield from _guard_lock(folder)
    yield from _verifications(folder, manifest)


def uncovered(folder: Path, head: str | None) -> Iterator[tuple[str, str]]:
    """Yield file and reason for each file of a sealed run whose bytes `check` cannot verify; it
    covers all others.
    """
    if head is None and not has_digest(folder):
        yield NAME, "has no digest, as in 0.1.0: only --head shows a change"
    for name, why in NOT_VOUCHED_FOR.items():
        if os.path.lexists(folder / name):
            yield name, why
    report, said = _report(folder), _annotations(folder)[0]
    written = {} if report is None else report.get("written", {})
    for name, why in DERIVED.items():
        if name not in written and os.path.lexists(folder / name):
            yield name, why
    if report is None:
        return
    anew = f"`jbclog report {folder}` makes the report anew"
    if said.report is None:
        yield (
            REPORT,
            f"not vouched for: no line of {ANNOTATIONS} has its hash; {anew} and adds the line",
        )
    if not written:
        for name in _of_report(folder):
            yield name, f"not vouched for: {REPORT} has no hash of it; {anew}, with its hashes"


def _lease(folder: Path, manifest: Manifest) -> Iterator[tuple[str, str]]:
    """Check a remaining lease: its tools may be hot, and the manifest names the same stations; or
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
    """Check a remaining lock: a killed guard can leave one, as an empty file."""
    try:
        found = (folder / guard_actions.LOCK).lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISREG(found.st_mode):
        yield guard_actions.LOCK, "is not a regular file; no guard leaves that"
    elif found.st_size:
        yield guard_actions.LOCK, f"has {found.st_size} bytes; a guard leaves an empty file"


def _verifications(folder: Path, manifest: Manifest) -> Iterator[tuple[str, str]]:
    """Check that each verification cited by the manifest is a line of the file beside the run, if
    that exists.
    """
    cited = {
        one.sha256: f"{one.station} port {one.port}"
        for one in reversed(manifest.verifications)
        if one.sha256 is not None
    }
    path = folder.absolute().parent / VERIFICATIONS
    if not cited:
        return
    try:
        lines = {sha256(line) for line in read_regular(path, Kind.VERIFICATIONS).split(b"\n")}
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


def _report_disagreements(folder: Path, said: Annotations) -> Iterator[tuple[str, str]]:
    """Yield file and text of each hash of the report, its files and the annotations that does not
    fit.

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
    head = str(report.get("annotations_head", own))
    if report["manifest_sha256"] == own and said.links and head not in said.links:
        yield (
            ANNOTATIONS,
            f"lacks the line that was last when {REPORT} was made: lines were changed or removed",
        )
    written = report.get("written")
    if written:  # those of 0.1.0 have none
        derived = [name for name in DERIVED if name in written]
        there = {name for name in derived if os.path.lexists(folder / name)}
        yield from _report_files(folder, written, {*made} | there)


def _report(folder: Path) -> dict[str, Any] | None:
    """Return the report's facts; None without a report or if the file is not one."""
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
    names = (
        f"{below}{path.name}"
        for below in ("", *(name for name, _ in MADE if is_plain_folder(folder / name)))
        for path in _inside(folder / below)
        if not is_plain_folder(path)
    )
    return sorted(name for name in names if is_of_report(name) and name != REPORT)


def _inside(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:
        return []  # `check` reports it


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
    """Return the SHA-256 of a file; if it cannot be read, a text that no hash equals."""
    try:
        with open_regular(path, Kind.OF_REPORT) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        return f"not known: {error}"


def _annotations(folder: Path) -> tuple[Annotations, list[str]]:
    try:
        found = read(folder)
    except RecordError as error:
        return Annotations(), [str(error)]
    return found, [f"line {number} {text}" for number, text in found.wrong]
