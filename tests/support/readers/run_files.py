"""What tests read of the files of a run, in one call."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from jbclog.core.capture_rows import CaptureRow
from jbclog.record.capture import Hole, rows_and_holes
from jbclog.report.verify import verified


def read_rows(path: Path) -> Iterator[CaptureRow]:
    """The intact rows of a capture, without what is missing between them."""
    return (row for row in rows_and_holes(path) if not isinstance(row, Hole))


def verify_report(folder: Path | str) -> list[str]:
    """What differs or cannot be compared, a sentence each; empty: all is compared and agrees."""
    found = verified(folder)
    return [*found.differing, *found.not_compared]
