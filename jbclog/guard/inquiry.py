"""How `jbclog safe` and a guard at work share ports: `safe` asks, the guard finishes its try and
reports, and leaves the ports alone until `safe` is done.

The guard keeps its proofs, and the number of its orders: only it orders a station that does not
answer. The socket is an abstract one, named after the run's folder; it is gone with the guard.
"""

from __future__ import annotations

import json
import os
import select
import socket
import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Self

from jbclog.core.json_files import builder, json_of
from jbclog.core.serial_line import is_one_port

ANSWER_S: Final = 9.0  # a try of the guard takes 3 s; 8 s with a driver that hangs
DONE_S: Final = 300.0  # for `safe`, which may ask a person, before the guard resumes
LONGEST: Final = 1 << 20
CREDENTIALS: Final = struct.Struct("3i")


@dataclass(frozen=True, slots=True)
class Unsafe:
    """A station that a guard could not make safe. `texts`: why, by port; 0 for all of it. `orders`:
    sent without an answer. `other`: what was found in its place.
    """

    name: str
    url: str
    texts: dict[int, str]
    orders: int = 0
    other: str | None = None

    def is_at(self, url: str) -> bool:
        return is_one_port(self.url, url)


_build_report: Final = builder(tuple[Unsafe, ...])


def _address(folder: Path) -> bytes:
    """Return the name of a guard's socket. Raises OSError."""
    found = folder.stat()
    return f"\0jbclog-guard-{found.st_dev}-{found.st_ino}".encode()


class Inquiries:
    """The guard's side. Without such sockets, as on another system, nobody asks."""

    def __init__(self, folder: Path) -> None:
        self._socket: socket.socket | None = None
        with suppress(OSError, AttributeError):
            listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self._socket = listening
            listening.bind(_address(folder))
            listening.listen()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._socket is not None:
            self._socket.close()

    def wait(self, seconds: float) -> socket.socket | None:
        """Wait for `seconds`, or until somebody of this user asks; return the connection."""
        watched = select.poll()
        if self._socket is not None:
            watched.register(self._socket, select.POLLIN)
        if not watched.poll(seconds * 1000) or self._socket is None:
            return None
        with suppress(OSError):
            asking, _ = self._socket.accept()
            if _user_of(asking) in (0, os.getuid()):
                return asking
            asking.close()
        return None


def _user_of(connection: socket.socket) -> int:
    data = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, CREDENTIALS.size)
    return int(CREDENTIALS.unpack(data)[1])


def answer(asking: socket.socket, stations: Sequence[Unsafe]) -> None:
    """Send the report, and wait until the other side is done. Does not raise."""
    rows = [asdict(station) for station in stations]
    with suppress(OSError), asking:
        asking.settimeout(DONE_S)
        asking.sendall(json.dumps(rows).encode())
        asking.shutdown(socket.SHUT_WR)
        asking.recv(1)  # it closes its end


class Inquiry:
    """The side of `jbclog safe`, to the guard of the run in `folder`, which opens no port from its
    answer until `close`. `is_at_work`: there is such a guard.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.is_at_work = False
        self._socket: socket.socket | None = None
        with suppress(OSError, AttributeError):
            asking = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self._socket = asking
            asking.settimeout(ANSWER_S)
            asking.connect(_address(folder))
            self.is_at_work = _user_of(asking) in (0, os.getuid())

    def answer(self) -> tuple[Unsafe, ...]:
        """Wait for the guard's try; return what it could not make safe."""
        with suppress(OSError, ValueError):
            if self._socket is not None and self.is_at_work:
                return _build_report(json_of(_read_all(self._socket)))
        return ()

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()


def _read_all(connection: socket.socket) -> bytes:
    """Read to the end. Raises OSError, also for too long an answer."""
    data = b""
    while len(data) < LONGEST:
        part = connection.recv(65536)
        if not part:
            return data
        data += part
    raise OSError("the answer is too long")
