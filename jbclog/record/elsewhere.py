"""What a sealed run says of itself, held against what others say of it.

Hashes inside a folder show what was changed by accident or in haste. Who writes all of them anew is shown by what
stands elsewhere: the next run's manifest, a report, an annotation, a printed page.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from jbclog.errors import RecordError
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import read
from jbclog.record.lineage import broken_links, is_head, short_head
from jbclog.record.manifest import NAME, Manifest, manifest_sha256

REPORT: Final = "report.json"


def disagreements(folder: Path, manifest: Manifest, head: str | None) -> Iterator[tuple[str, str]]:
    """File and sentence for each."""
    own = manifest_sha256(folder)
    if head is not None and not is_head(head, own):
        yield NAME, f"is not the one that was told: its head is {short_head(own)}"
    for text in broken_links(folder, manifest):
        yield NAME, text
    yield from _report(folder, own)
    yield from _annotations(folder)


def _report(folder: Path, own: str) -> Iterator[tuple[str, str]]:
    try:
        named = json.loads((folder / REPORT).read_bytes())["manifest_sha256"]
    except FileNotFoundError:
        return
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        yield REPORT, "is no report of a run"
        return
    if named != own:
        yield REPORT, f"was made from another manifest: {short_head(str(named))}, this one is {short_head(own)}"


def _annotations(folder: Path) -> Iterator[tuple[str, str]]:
    try:
        found = read(folder)
    except RecordError as error:
        yield ANNOTATIONS, str(error)
        return
    for number, text in found.wrong:
        yield ANNOTATIONS, f"line {number} {text}"
