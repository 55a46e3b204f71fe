"""How much of what comes over one port is taken at a time, so that a port that never falls silent costs the others nothing.

An answer has some sixty bytes at the most. A read that gives `MOST_AT_ONCE`, and one more after `MOST_READS` that brought no
answer, are no station's: then the port is not read for `REST_S`. What comes meanwhile waits in the system, whose own limit stops
the sender; a serial device loses it. Of bytes that came unasked `MOST_KEPT` or a little more are kept, and then nothing is read
until the session has taken them.

What a flood is, and what becomes of the link then, is for whoever speaks to the station.
"""

from __future__ import annotations

from typing import Final

from jbclog.transport.port import MOST_AT_ONCE

MOST_KEPT: Final = MOST_AT_ONCE
MOST_READS: Final = 64  # since the last question: more than an answer has bytes, should they come one by one
REST_S: Final = 0.05


class Budget:
    """What one port may still give until it has to rest."""

    __slots__ = ("_reads",)

    def __init__(self) -> None:
        self._reads = 0

    def asked(self) -> None:
        """A question goes out: its answer may come in pieces."""
        self._reads = 0

    def is_spent(self, size: int) -> bool:
        """Whether the port has to rest after a read that gave `size` bytes."""
        self._reads += 1
        return size >= MOST_AT_ONCE or self._reads > MOST_READS
