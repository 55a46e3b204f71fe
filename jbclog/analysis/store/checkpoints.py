"""Limits of a table's log, which the library reads whole: its checkpoints, which are Parquet, and
the commits behind them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Final

from jbclog.core.foreign.files import MIB, Kind, NotReadable, open_foreign, read_foreign
from jbclog.core.foreign.parquet_sizes import sizes_of

WHOLE: Final = re.compile(r"\d{20}\.checkpoint\.parquet")
FREE_ROWS: Final = 10_000
BYTES_A_ROW: Final = 8  # each names a file at random
FREE_BYTES: Final = 64 * MIB
TIMES: Final = 64  # of its size; statistics as JSON pack to a tenth
KEPT: Final = 1000
COMMIT: Final = re.compile(r"\d{20}\.json")
# a checkpoint follows each hundredth commit; one that joins 10 000 files has 10 000 lines and more
MOST_LINES: Final = 100_000
LINES: Final = re.compile(rb"\n|\}[ \t\r]*\{")  # the library needs no line end between two objects
SHORTEST: Final = 64  # bytes of a line that names a file


def expect_bounded(paths: Iterable[Path]) -> None:
    """Raise `NotReadable` if what the library may read takes too much: the newest checkpoint that
    is one file, all in parts, and the commits behind the newest.
    """
    log = [*paths]
    found = sorted(path for path in log if path.suffix == ".parquet")
    whole = [path for path in found if WHOLE.fullmatch(path.name)]
    _expect_few_lines(log, whole[-1].name[:20] if whole else "")
    for path in {*found} - {*whole[:-1]}:
        there = path.lstat()
        _looked_at(path, there.st_ino, there.st_size, there.st_mtime_ns, there.st_ctime_ns)


def _expect_few_lines(log: Iterable[Path], checkpoint: str) -> None:
    """`checkpoint` is the number of the newest one: the library reads the commits behind it."""
    commits = [path for path in log if COMMIT.fullmatch(path.name) and path.stem > checkpoint]
    if sum(path.lstat().st_size for path in commits) <= MOST_LINES * SHORTEST:
        return
    lines = sum(len(LINES.findall(read_foreign(path, Kind.STORE_LOG))) for path in commits)
    if lines > MOST_LINES:
        raise NotReadable(
            f"its commits since the last checkpoint have {lines} lines, at most {MOST_LINES}"
        )


@lru_cache(maxsize=KEPT)
def _looked_at(path: Path, *_: int) -> None:
    try:
        with open_foreign(path, Kind.STORE_LOG) as data:
            found = sizes_of(data)
    except NotReadable as error:
        raise NotReadable(f"{path.name}: {error}") from error
    if found.rows > FREE_ROWS + found.size / BYTES_A_ROW:
        raise NotReadable(f"{path.name}: has {found.rows} rows in {found.size} bytes")
    if found.written() > FREE_BYTES + found.size * TIMES:
        raise NotReadable(
            f"{path.name}: unpacks to {found.written() // MIB} MiB from {found.size} bytes"
        )
