"""What a sealed run says of itself, held against what others say of it.

Hashes inside a folder show what was changed by accident or in haste. Who writes all of them anew is shown by what
stands elsewhere: the next run's manifest, a report, an annotation, a printed page.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from jbclog.errors import RecordError
from jbclog.foreign.files import Kind, open_foreign, read_foreign
from jbclog.foreign.numbers import read_json
from jbclog.record import guarded, left_hot
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import read
from jbclog.record.chained import lines_in, sha256
from jbclog.record.conclude import is_of_report
from jbclog.record.lineage import broken_links, is_head, short_head
from jbclog.record.manifest import NAME, Manifest, manifest_sha256

REPORT: Final = "report.json"
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
    yield from report_disagreements(folder)
    yield from _annotations(folder)
    yield from _lease(folder, manifest)
    yield from _verifications(folder, manifest)


def _lease(folder: Path, manifest: Manifest) -> Iterator[tuple[str, str]]:
    """It is there only while tools that it names may be hot, and then the manifest says so, too."""
    if not os.path.lexists(folder / guarded.LEASE):
        return
    named = left_hot.leases(folder).keys()
    unknown = named - {facts.name for facts in manifest.stations if facts.unsafe}
    if not named:
        yield guarded.LEASE, "is there, and says of no station that its tools may be hot"
    elif unknown:
        yield guarded.LEASE, f"says that tools of {', '.join(sorted(unknown))} may be hot, and the manifest does not"


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


def report_disagreements(folder: Path) -> Iterator[tuple[str, str]]:
    """File and sentence for each.

    The report names the manifest that it was made from, and the hash of each file that was written with it.
    """
    own = manifest_sha256(folder)
    made = [name for path in folder.rglob("*") if path.is_file() and is_of_report(name := path.relative_to(folder).as_posix())]
    try:
        report = read_json(folder / REPORT, Kind.REPORT)
        named, files = report["manifest_sha256"], dict(report.get("written", {}))
    except FileNotFoundError:
        yield from ((name, f"stands without {REPORT}, which would vouch for it; make the report again") for name in sorted(made))
        return
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        yield REPORT, "is no report of a run"
        return
    if named != own:
        yield REPORT, f"was made from another manifest: {short_head(str(named))}, this one is {short_head(own)}"
    if files:  # reports of before had none
        yield from _files(folder, files, {*made} - {REPORT})


def _files(folder: Path, told: dict[str, str], made: set[str]) -> Iterator[tuple[str, str]]:
    for name in sorted(made - {*told}):
        yield name, f"was not written with {REPORT}; make the report again"
    for name in sorted({*told} - made):
        yield str(name), f"was written with {REPORT} and is missing; make the report again"
    for name in sorted(made & {*told}):
        if _sha256(folder / name) != told[name]:
            yield name, f"was changed since {REPORT} was written; make the report again"


def _sha256(path: Path) -> str:
    """In words where it cannot be read: that is no hash, and so differs."""
    try:
        with open_foreign(path, Kind.OF_REPORT) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        return f"not known: {error}"


def _annotations(folder: Path) -> Iterator[tuple[str, str]]:
    try:
        found = read(folder)
    except RecordError as error:
        yield ANNOTATIONS, str(error)
        return
    for number, text in found.wrong:
        yield ANNOTATIONS, f"line {number} {text}"
