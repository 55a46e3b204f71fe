"""What tests read of the files of a run, in one call."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from jbclog.core.capture_rows import CaptureRow
from jbclog.report.write import report_files
from support.product import rows_of_capture


def read_rows(path: Path) -> Iterator[CaptureRow]:
    """The rows of a file of a capture."""
    return iter(rows_of_capture(path))


def differing_files(folder: Path | str) -> list[str]:
    """The names of a report's files that are not, byte for byte, what the run gives once more."""
    return sorted(
        name
        for name, content in report_files(Path(folder)).items()
        if not (Path(folder) / name).is_file() or (Path(folder) / name).read_bytes() != content
    )
