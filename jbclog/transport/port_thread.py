"""Give a descriptor to a port that has none (rfc2217): a thread reads the port and makes the
descriptor readable.
"""

from __future__ import annotations

import os
import select
import threading

from jbclog.core.errors import LinkError
from jbclog.transport.port import Port

LOOK_S = 0.2  # interval at which the thread checks whether the port was closed


def with_descriptor(port: Port) -> Port:
    """Return the port, read by a thread if it has no descriptor to watch. Raises OSError, and
    closes the port, if the system gives none.
    """
    if port.fileno() is not None:
        return port
    try:
        return ThreadPort(port)
    except BaseException:
        port.close()
        raise


class ThreadPort:
    """A `Port` that a thread reads, one piece at a time: the next once `read_now` has taken the
    last one. So a port that is not read makes its sender wait.
    """

    def __init__(self, port: Port) -> None:
        self._port = port
        self._descriptor = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._piece = b""
        self._error: LinkError | None = None
        self._is_closed = False
        self._lock = threading.Lock()  # the descriptor's number may be another file's once closed
        self._may_read = threading.Event()
        threading.Thread(target=self._read, name="read-port", daemon=True).start()

    @property
    def url(self) -> str:
        return self._port.url

    def fileno(self) -> int | None:
        return self._descriptor

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def read_now(self) -> bytes:
        if self._error is not None:
            raise self._error
        try:
            os.eventfd_read(self._descriptor)
        except BlockingIOError:  # nothing was read since
            return b""
        piece = self._piece
        self._may_read.set()
        return piece

    def read(self, timeout_s: float) -> bytes:
        watched = select.poll()
        watched.register(self._descriptor, select.POLLIN)
        watched.poll(max(timeout_s, 0.0) * 1000)
        return self.read_now()

    def close(self) -> None:
        with self._lock:
            if self._is_closed:
                return
            self._is_closed = True
            os.close(self._descriptor)
        self._may_read.set()
        self._port.close()

    def _read(self) -> None:
        while not self._is_closed and self._error is None:
            try:
                self._piece = self._port.read(LOOK_S)
            except LinkError as error:
                self._error = error
            if self._piece or self._error:
                self._hand_over()

    def _hand_over(self) -> None:
        """Make the descriptor readable, and wait until the piece is taken or the port closed."""
        with self._lock:
            if self._is_closed:
                return
            self._may_read.clear()
            os.eventfd_write(self._descriptor, 1)
        self._may_read.wait()
