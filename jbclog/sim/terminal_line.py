"""The line format that a client has set on a pseudo-terminal, which has no wire and passes bytes on at any.

Linux keeps rate, stop bits and the mark for odd parity, and drops the one for parity as such: there even cannot be told
from none.
"""

from __future__ import annotations

import struct
from contextlib import suppress

with suppress(ImportError):  # Windows has no terminals
    import fcntl
    import termios

from jbclog.core.line_format import LineFormat

TCGETS2 = 0x802C542A  # rates of any number; the same on all machines but MIPS, PowerPC, SPARC and Alpha
_SETTINGS = struct.Struct("4I B 19s 2I")


def line_set(descriptor: int, like: LineFormat) -> LineFormat:
    """What the client of the terminal behind `descriptor` has set; `like` where, or as far as, that cannot be told."""
    try:
        settings = fcntl.ioctl(descriptor, TCGETS2, bytes(_SETTINGS.size))
    except (OSError, NameError):
        return like
    _, _, flags, _, _, _, baudrate, _ = _SETTINGS.unpack(settings)
    is_odd = bool(flags & termios.PARODD)
    if baudrate <= 0 or (baudrate == like.baudrate and is_odd == (like.parity == "O")):
        return like
    parity = "O" if is_odd else "N" if like.parity == "O" else like.parity
    return LineFormat(baudrate, f"8{parity}{like.stop_bits}")
