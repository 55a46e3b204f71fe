"""A port that passes reads and refuses everything else (docs/reference/faults.md, S-5).

The caller defines what a read is, because that depends on the protocol: `protocol.frame.only_reads`
for JBC's. Unknown bytes are refused, and so is any unforeseen command.
"""

from __future__ import annotations

from collections.abc import Callable

from jbclog.core.errors import WriteForbidden
from jbclog.transport.port import Port

OnlyReads = Callable[[bytes], bool]
"""Returns True if these bytes only read."""


class ReadOnly:
    """A `Port` around a port. `write` raises `WriteForbidden`, and sends nothing, for bytes that
    `only_reads` rejects.
    """

    def __init__(self, port: Port, only_reads: OnlyReads) -> None:
        self._port = port
        self._only_reads = only_reads

    @property
    def url(self) -> str:
        return self._port.url

    def fileno(self) -> int | None:
        return self._port.fileno()

    def write(self, data: bytes) -> None:
        if not self._only_reads(data):
            raise WriteForbidden(
                f"{self.url} is open for reading only; {data.hex(' ')} was not sent"
            )
        self._port.write(data)

    def read_now(self) -> bytes:
        return self._port.read_now()

    def read(self, timeout_s: float) -> bytes:
        return self._port.read(timeout_s)

    def close(self) -> None:
        self._port.close()
