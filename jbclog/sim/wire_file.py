"""The wire of all served stations as a file of JSON lines, for tests and for people who look for a fault."""

from __future__ import annotations

import json
from pathlib import Path


class WireFile:
    """``{"t": 123.4, "station": "dde-1", "kind": "question", "text": "0001RTT1", "hex": "02..."}``.

    `t` is in monotonic seconds, when the bytes were read or written; `kind` is question, answer, unplugged or
    plugged; `text` is what is printable of the bytes.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="ascii", buffering=1)

    def note(self, moment: float, station: str, kind: str, data: bytes) -> None:
        text = "".join(chr(byte) for byte in data[:-1] if 0x20 <= byte < 0x7F)  # the last byte is the check byte
        self._file.write(json.dumps({"t": moment, "station": station, "kind": kind, "text": text, "hex": data.hex()}) + "\n")

    def close(self) -> None:
        self._file.close()


class NoWireFile(WireFile):
    """Notes nothing."""

    def __init__(self) -> None:
        return

    def note(self, moment: float, station: str, kind: str, data: bytes) -> None:
        return

    def close(self) -> None:
        return
