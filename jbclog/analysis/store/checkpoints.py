"""Limits of a table's log, checked because the library reads it whole: its checkpoints, which are
Parquet files, and the commits after them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Final

from jbclog.analysis.store.parquet_sizes import sizes_of
from jbclog.core.files import MIB, Kind, NotReadable, open_regular, read_regular

WHOLE: Final = re.compile(r"\d{20}\.checkpoint\.parquet")
FREE_ROWS: Final = 10_000
BYTES_A_ROW: Final = 8  # each row names a file by random characters, which do not compress
FREE_BYTES: Final = 64 * MIB
TIMES: Final = 64  # unpacked bytes for each byte; statistics as JSON compress to a tenth
KEPT: Final = 1000  # files whose check is remembered
COMMIT: Final = re.compile(r"\d{20}\.json")
# The library writes a checkpoint after each hundred commits; a commit that joins 10 000 files has
# more than 10 000 lines.
MOST_LINES: Final = 100_000
LINES: Final = re.compile(rb"\n|\}[ \t\r]*\{")  # the library accepts two objects on a line
SHORTEST: Final = 64  # least bytes of a line that names a file


def expect_bounded(paths: Iterable[Path]) -> None:
    """Raise `NotReadable` if the files that the library may read exceed the limits: the newest
    checkpoint in a single file, the commits after it, and all checkpoints in parts.
    """
    log = [*paths]
    found = sorted(path for path in log if path.suffix == ".parquet")
    whole = [path for path in found if WHOLE.fullmatch(path.name)]
    _expect_few_lines(log, whole[-1].name[:20] if whole else "")
    for path in {*found} - {*whole[:-1]}:
        there = path.lstat()
        _expect_bounded_checkpoint(
            path, there.st_ino, there.st_size, there.st_mtime_ns, there.st_ctime_ns
        )


def _expect_few_lines(log: Iterable[Path], checkpoint: str) -> None:
    """Limit the lines of the commits that the library reads: those after `checkpoint`, the number
    of the newest one.
    """
    commits = [path for path in log if COMMIT.fullmatch(path.name) and path.stem > checkpoint]
    if sum(path.lstat().st_size for path in commits) <= MOST_LINES * SHORTEST:
        return
    lines = sum(len(LINES.findall(read_regular(path, Kind.STORE_LOG))) for path in commits)
    if lines > MOST_LINES:
        raise NotReadable(
            f"its commits since the last checkpoint have {lines} lines, at most {MOST_LINES}"
        )


@lru_cache(maxsize=KEPT)
def _expect_bounded_checkpoint(path: Path, *_: int) -> None:
    """Check a checkpoint, once for each state of its file."""
    try:
        with open_regular(path, Kind.STORE_LOG) as data:
            found = sizes_of(data)
    except NotReadable as error:
        raise NotReadable(f"{path.name}: {error}") from error
    if found.rows > FREE_ROWS + found.size / BYTES_A_ROW:
        raise NotReadable(f"{path.name}: has {found.rows} rows in {found.size} bytes")
    if found.written() > FREE_BYTES + found.size * TIMES:
        raise NotReadable(
            f"{path.name}: unpacks to {found.written() // MIB} MiB from {found.size} bytes"
        )
