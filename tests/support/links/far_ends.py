"""The far ends of links, for tests of ports: pseudo-terminals, TCP servers and an rfc2217 server,
all real.
"""

from __future__ import annotations

import contextlib
import gc
import os
import pty
import select
import socket
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import serial
from serial import rfc2217
from support.command import until


class Terminal:
    """A pseudo-terminal whose far end is held here; `unplug()` is what pulling the cable does to a
    USB adapter.
    """

    def __init__(self) -> None:
        self.far, near = pty.openpty()
        tty.setraw(near)
        self.url = os.ttyname(near)
        os.close(near)

    def say(self, data: bytes) -> None:
        os.write(self.far, data)

    def heard(self, timeout_s: float = 1.0) -> bytes:
        ready, _, _ = select.select([self.far], [], [], timeout_s)
        return os.read(self.far, 4096) if ready else b""

    def heard_all(self, length: int) -> bytes:
        """So many bytes: the system may pass them on in pieces, and late."""
        heard = b""
        while len(heard) < length and (more := self.heard(20.0)):
            heard += more
        return heard

    def unplug(self) -> None:
        # first, as two threads may pull: who closes also wakes the one that waits
        far, self.far = self.far, -1
        if far >= 0:
            os.close(far)


class Server:
    """A TCP server that takes one client; `end()` closes the connection, `reset()` tears it."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._listening.getsockname()[1]}"
        self._client: socket.socket | None = None

    @property
    def client(self) -> socket.socket:
        if self._client is None:
            self._client, _ = self._listening.accept()
            self._client.settimeout(1.0)
        return self._client

    def reset(self) -> None:
        self.client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        self.client.close()

    def end(self) -> None:
        if self._client is not None:
            self._client.close()
        self._listening.close()


@contextlib.contextmanager
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    try:
        yield made
    finally:
        made.unplug()


@contextlib.contextmanager
def server() -> Iterator[Server]:
    made = Server()
    try:
        yield made
    finally:
        made.end()


class WithoutModemLines(serial.Serial):
    """A pseudo-terminal has no modem lines, and the server wants to tell of them."""

    cts = dsr = ri = cd = dtr = rts = False


class Rfc2217Server:
    """pyserial's own rfc2217 server before a pseudo-terminal."""

    def __init__(self, terminal: Terminal) -> None:
        self.device = WithoutModemLines(terminal.url, timeout=0.01)
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"rfc2217://127.0.0.1:{self._listening.getsockname()[1]}"
        self.client: socket.socket | None = None
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def end(self) -> None:
        for end in (self.client, self._listening):
            with contextlib.suppress(OSError, AttributeError):
                end.shutdown(socket.SHUT_RDWR)  # type: ignore[union-attr]  # there may have been no client
            if end is not None:
                end.close()
        self._thread.join(5)
        self.device.close()

    def _serve(self) -> None:
        # ValueError: closed by `end` just before it is watched
        with contextlib.suppress(OSError, ValueError):
            self.client, _ = self._listening.accept()
            manager = rfc2217.PortManager(self.device, self)
            while True:
                self._to_client(manager)
                ready, _, _ = select.select([self.client], [], [], 0.005)
                if ready and not self._to_device(manager):
                    return

    def _to_client(self, manager: rfc2217.PortManager) -> None:
        if waiting := self.device.in_waiting:
            self.write(b"".join(manager.escape(self.device.read(waiting))))

    def _to_device(self, manager: rfc2217.PortManager) -> bool:
        assert self.client is not None
        data = self.client.recv(1024)
        self.device.write(b"".join(manager.filter(data)))
        return bool(data)

    def write(self, data: bytes) -> None:
        """What `PortManager` answers to the client with."""
        assert self.client is not None
        self.client.sendall(data)


@contextlib.contextmanager
def rfc2217_server(terminal: Terminal) -> Iterator[Rfc2217Server]:
    made = Rfc2217Server(terminal)
    try:
        yield made
    finally:
        made.end()


def settled_descriptors() -> int:
    """How many this process has open once earlier tests' garbage is collected.

    Else it could be collected between a count and the next, which would then differ.
    """
    gc.collect()
    return open_descriptors()


def open_descriptors() -> int:
    """How many this process has open."""
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def are_closed_again(before: int) -> bool:
    """Whether it comes to no more than `before`: a port is closed by a thread, which is waited for
    `CLOSE_S` at most, and a busy machine may run it later.
    """
    return until(lambda: open_descriptors() <= before)


class StubbornServer:
    """An rfc2217 server, written from RFC 2217, that answers a setting with what it likes.

    `answers`: command of the client (1 baud rate, 2 data bits, 3 parity, 4 stop bits, 5 control) ->
    the value that it answers; None: no answer.
    """

    IAC, SE, SB, WILL, WONT, DO, DONT = 255, 240, 250, 251, 252, 253, 254
    COM_PORT = 44

    def __init__(self, answers: dict[int, int | None]) -> None:
        self._answers = answers
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"rfc2217://127.0.0.1:{self._listening.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def end(self) -> None:
        self._listening.close()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listening.accept()
                threading.Thread(target=self._talk, args=(client,), daemon=True).start()

    def _talk(self, client: socket.socket) -> None:
        waiting = b""
        with contextlib.suppress(OSError), client:
            while data := client.recv(1024):
                waiting = self._answer_all(client, waiting + data)

    def _answer_all(self, client: socket.socket, data: bytes) -> bytes:
        """Answer every complete command; return the rest."""
        while len(data) >= 3 and data[0] == self.IAC:
            if data[1] == self.SB:
                end = data.find(bytes((self.IAC, self.SE)))
                if end < 0:
                    return data
                self._answer(client, data[3], data[4:end])
                data = data[end + 2 :]
            else:
                agreed = {self.WILL: self.DO, self.DO: self.WILL}.get(data[1])
                if agreed is not None:
                    client.sendall(bytes((self.IAC, agreed, data[2])))
                data = data[3:]
        return data

    def _answer(self, client: socket.socket, command: int, asked: bytes) -> None:
        value: bytes | None = asked
        if command in self._answers:
            wanted = self._answers[command]
            value = None if wanted is None else wanted.to_bytes(len(asked), "big")
        if value is not None:
            head = bytes((self.IAC, self.SB, self.COM_PORT, command + 100))
            client.sendall(head + value + bytes((self.IAC, self.SE)))
