"""Links between a run and its virtual stations that can be flooded: ``python tests/support
links.flooders PLAN`` serves them.

PLAN is a JSON file: for each link ``near`` (a path for a pseudo-terminal, or empty for a TCP port),
``far`` (the virtual station's link), ``shape``, ``bytes_per_s`` (0: as many as are taken),
``piece`` (bytes handed over at once), and from which second to which behind the first question that
has ``after`` in it. Answers pass all the while. The first line of stdout are the URLs.
"""

from __future__ import annotations

import json
import os
import select
import socket
import subprocess
import sys
import termios
import time
import tty
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Self

from support import program

EVERY_S = 0.005


@dataclass(frozen=True)
class Flooded:
    """One link."""

    near: str
    far: str
    shape: str
    bytes_per_s: float
    begin_s: float
    end_s: float
    piece: int = 4096
    after: str = ""


class Flooders:
    """Serves these links in a process of its own while a `with` lasts; `urls` are for the run."""

    def __init__(self, plan: Path, links: Sequence[Flooded]) -> None:
        self._plan = plan
        plan.write_text(json.dumps([asdict(link) for link in links]))
        self.urls: list[str] = []

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(
            program("links.flooders", self._plan), stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self._process.stdout is not None
        self.urls = json.loads(self._process.stdout.readline())
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()


class Link:
    """One link while it is served."""

    def __init__(self, plan: Flooded) -> None:
        from support.links.flooding import pieces

        self.plan = plan
        self.far = os.open(plan.far, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self.far)
        settings = termios.tcgetattr(self.far)
        # a virtual station hears who speaks at another rate, and not what
        settings[4] = settings[5] = termios.B19200
        termios.tcsetattr(self.far, termios.TCSANOW, settings)
        self.near: int | None = None
        self.server: socket.socket | None = None
        self.client: socket.socket | None = None
        self.began: float | None = None
        self.sent = 0
        self.rest = b""
        self.answers = b""
        self._pieces: Iterator[bytes] = pieces(plan.shape, plan.piece)
        if plan.near:
            self.near, self._slave = os.openpty()
            tty.setraw(self._slave)
            Path(plan.near).symlink_to(os.ttyname(self._slave))
            os.set_blocking(self.near, False)
            self.url = plan.near
        else:
            self.server = socket.create_server(("127.0.0.1", 0))
            self.url = f"socket://127.0.0.1:{self.server.getsockname()[1]}"

    def watched(self) -> list[int]:
        return [
            one
            for one in (self.far, self.near, self.server and self.server.fileno())
            if one is not None
        ]

    def on_readable(self, descriptor: int) -> None:
        if self.server is not None and descriptor == self.server.fileno():
            self._accept()
            return
        data = b""
        with suppress(OSError):
            data = os.read(descriptor, 4096)
        if descriptor == self.far:
            self.answers = (self.answers + data)[-4096:]
        elif data:
            if self.plan.after.encode() in data:
                self.began = self.began or time.monotonic()
            with suppress(OSError):
                os.write(self.far, data)
        elif self.client is not None:
            self.client.close()
            self.client = self.near = None
            self.rest = b""

    def _accept(self) -> None:
        assert self.server is not None
        if self.client is not None:
            self.client.close()
        self.client, _ = self.server.accept()
        self.client.setblocking(False)
        self.client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.near, self.rest, self.answers = self.client.fileno(), b"", b""

    @property
    def floods(self) -> bool:
        at_s = time.monotonic() - (self.began or 1e12)
        return self.plan.begin_s <= at_s < self.plan.end_s

    def send(self) -> None:
        """What is due: answers first, at the borders of pieces."""
        if self.near is None or not (self._sent_all()):
            return
        if self.answers:
            self.rest, self.answers = self.answers, b""
            if not self._sent_all():
                return
        if not self.floods:
            self.sent = 0
            return
        due = (time.monotonic() - (self.began or 0.0) - self.plan.begin_s) * self.plan.bytes_per_s
        for _ in range(200):
            if self.plan.bytes_per_s and self.sent >= due:
                return
            self.rest = next(self._pieces)
            self.sent += len(self.rest)
            if not self._sent_all():
                return

    def _sent_all(self) -> bool:
        while self.rest and self.near is not None:
            try:
                self.rest = self.rest[os.write(self.near, self.rest) :]
            except BlockingIOError:
                if self.plan.bytes_per_s and self.near is not None and self.client is None:
                    self.rest = b""  # a wire waits for nobody
                return False
            except OSError:
                self.rest = b""
                return False
        return True


def main() -> None:
    links = [Link(Flooded(**one)) for one in json.loads(Path(sys.argv[1]).read_text())]
    print(json.dumps([link.url for link in links]), flush=True)
    stdin: IO[str] = sys.stdin
    while True:
        owners = {descriptor: link for link in links for descriptor in link.watched()}
        ready, _, _ = select.select([*owners, stdin], [], [], EVERY_S)
        if stdin in ready:
            return
        for descriptor in ready:
            owners[descriptor].on_readable(descriptor)
        for link in links:
            link.send()


if __name__ == "__main__":
    main()
