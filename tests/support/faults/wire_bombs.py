"""Serial captures with heads of blocks that no recorder writes: small files that take long to
search.
"""

from __future__ import annotations

import zlib
from pathlib import Path

from jbclog.record.capture import Head, head_line
from jbclog.record.capture_file import FIELD_BYTES, FIELD_NAME, FIXED, HEAD, MOST_BYTES

KIN = zlib.crc32(head_line(Head("a", "/dev/ttyUSB0", "tht.toml", 1.0, 1_790_000_000.0)).encode())


def heads_in_one_another(path: Path) -> None:
    """100 000 heads in 3.6 MB, each of a block that is said to go on for 64 MiB."""
    told = (FIXED, FIELD_BYTES + 4, FIELD_NAME, FIELD_BYTES, 1 << 20, 10, KIN, MOST_BYTES)
    head = HEAD.pack(*told, zlib.crc32(HEAD.pack(*told, 0)[:-4]))
    path.write_bytes(head * 100_000)


def beginnings(path: Path) -> None:
    """A hundred megabytes of what heads begin with."""
    path.write_bytes(FIXED * 10_000_000)
