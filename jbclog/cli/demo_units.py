"""The barcode reader of `jbclog demo`."""

from __future__ import annotations

from collections.abc import Sequence
from time import monotonic

from jbclog.transport.typed_lines import LineSource


class BarcodeReader(LineSource):
    """Types the first serial at the first look, each further one `every_s` after the one before."""

    def __init__(self, serials: Sequence[str], every_s: float) -> None:
        self.name = "the demo's barcode reader"
        self.is_typed = False
        self._serials = list(serials)
        self._every_s = every_s
        self._next_at = monotonic()

    def read(self) -> bytes:
        now = monotonic()
        if not self._serials or now < self._next_at:
            return b""
        self._next_at = now + self._every_s
        serial = self._serials.pop(0)
        return f"{serial}\n".encode()

    def close(self) -> None:
        """There is nothing to close."""
