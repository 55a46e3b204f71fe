"""S3 servers that never answer, or never come to an end."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Self

import pytest

from support.faults.s3_server import Server

PROXIES = ("http_proxy", "https_proxy", "all_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY")


def _silent(opened: socket.socket) -> None:
    while opened.recv(1 << 16):
        pass


def _a_byte_a_second(opened: socket.socket) -> None:
    opened.recv(1 << 16)  # bytes that nobody has asked for yet are another mistake
    _head_by_bytes(opened)


def _closes(opened: socket.socket) -> None:
    opened.close()


def _noise(opened: socket.socket) -> None:
    opened.sendall(b"\0\xff" * 10_000)


def _pages_without_end(opened: socket.socket) -> None:
    """Each list is said to go on, always at the same place."""
    body = (
        b'<?xml version="1.0"?><ListBucketResult><IsTruncated>true</IsTruncated>'
        b"<NextContinuationToken>x</NextContinuationToken></ListBucketResult>"
    )
    head = f"HTTP/1.1 200 OK\r\nContent-Length: {len(body)}\r\n\r\n".encode()
    while opened.recv(1 << 16):
        opened.sendall(head + body)


SERVERS: dict[str, Callable[[socket.socket], None]] = {
    "silent": _silent,
    "a byte a second": _a_byte_a_second,
    "closes": _closes,
    "noise": _noise,
    "lists without end": _pages_without_end,
}
EMPTY_LIST = (
    b'<?xml version="1.0"?><ListBucketResult><IsTruncated>false</IsTruncated></ListBucketResult>'
)
EMPTY_LIST_ANSWER = b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n" % len(EMPTY_LIST) + EMPTY_LIST


def _then(answer: Callable[[socket.socket], None]) -> Callable[[socket.socket], None]:
    """Lists the folder that is asked for first, as a server should; then answers so."""

    def speaks(opened: socket.socket) -> None:
        while asked := opened.recv(1 << 16):
            if b"_nothing" not in asked.partition(b"\r\n")[0]:
                answer(opened)
                return
            opened.sendall(EMPTY_LIST_ANSWER)

    return speaks


def _head_by_bytes(opened: socket.socket) -> None:
    _by_bytes(opened, b"HTTP/1.1 200 OK\r\nX: " + b"x" * 600)


def _body_by_bytes(opened: socket.socket) -> None:
    opened.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 600\r\n\r\n")
    _by_bytes(opened, b"<" * 600)


def _by_bytes(opened: socket.socket, text: bytes) -> None:
    for letter in text:
        opened.sendall(bytes([letter]))
        time.sleep(1)


LATER: dict[str, Callable[[socket.socket], None]] = {
    "a head by bytes": _then(_head_by_bytes),
    "a body by bytes": _then(_body_by_bytes),
}
"""Servers that answer the first question, and no other within ten minutes."""
NO_ANSWER = ("silent", "a byte a second", "lists without end")
"""Of these no answer is ever whole."""


@dataclass
class SilentServer:
    """One of them, which the environment names as long as a `with` lasts. `connections` counts
    those that were opened.
    """

    kind: str
    monkeypatch: pytest.MonkeyPatch
    connections: int = field(default=0, init=False)

    def __enter__(self) -> Self:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()
        for name, value in Server(self.port).environment.items():
            self.monkeypatch.setenv(name, value)
        for name in PROXIES:
            self.monkeypatch.delenv(name, raising=False)
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)  # wakes who accepts
        self._listening.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                opened, _ = self._listening.accept()
                self.connections += 1
                threading.Thread(target=self._answer, args=(opened,), daemon=True).start()

    def _answer(self, opened: socket.socket) -> None:
        with suppress(OSError), opened:
            (SERVERS | LATER)[self.kind](opened)
