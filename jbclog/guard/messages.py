"""What the guard says to people, on the stderr that it has from its recorder: never waited for, for nobody may read it."""

from __future__ import annotations

import os
import select
from contextlib import suppress

from jbclog.core.text import clean

STDERR = 2


def say(text: str) -> None:
    """A line, where it can be written at once. What a station or a file brought must not steer a terminal."""
    with suppress(Exception):  # nothing that is said is worth a tool
        watched = select.poll()
        watched.register(STDERR, select.POLLOUT)
        if any(event & select.POLLOUT for _, event in watched.poll(0)):
            os.write(STDERR, f"{clean(f'jbclog guard: {text}')}\n".encode("utf-8", "backslashreplace")[: select.PIPE_BUF])


def let_go(stream: int) -> None:
    """Let who reads `stream` come to its end; what is said there from now on is lost."""
    with suppress(OSError):
        null = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
        os.dup2(null, stream)
        os.close(null)
