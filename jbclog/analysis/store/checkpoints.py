"""Limits of the checkpoints in a table's log, which are Parquet that the library reads whole."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Final

from jbclog.core.foreign.files import MIB, Kind, NotReadable, open_foreign
from jbclog.core.foreign.parquet_sizes import sizes_of

WHOLE: Final = re.compile(r"\d{20}\.checkpoint\.parquet")
FREE_ROWS: Final = 10_000
BYTES_A_ROW: Final = 8  # each names a file at random
FREE_BYTES: Final = 64 * MIB
TIMES: Final = 64  # of its size; statistics as JSON pack to a tenth
KEPT: Final = 1000


def expect_bounded(paths: Iterable[Path]) -> None:
    """Raise `NotReadable` if a checkpoint that the library may read takes too much: the newest that
    is one file, and all in parts.
    """
    found = sorted(path for path in paths if path.suffix == ".parquet")
    whole = [path for path in found if WHOLE.fullmatch(path.name)]
    for path in {*found} - {*whole[:-1]}:
        there = path.lstat()
        _looked_at(path, there.st_ino, there.st_size, there.st_mtime_ns, there.st_ctime_ns)


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
