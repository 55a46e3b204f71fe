"""What pyserial lacks with an rfc2217 server: its answers to the line settings (RFC 2217, section
3), a limit to what it may send, and silence when it is gone.

pyserial compares each answer with what it asked and keeps neither: "remote rejected value for
option 'baudrate'". `ServerAnswers` listens in, so that an error can show both.
"""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Callable
from queue import Queue
from typing import Final

import serial
from jbclog.core.serial_line import LineFormat
from jbclog.transport.port import BROKEN

MOST_WAITING = 4096  # bytes that pyserial buffers

# commands of the server: SET-BAUDRATE, -DATASIZE, -PARITY, -STOPSIZE, -CONTROL (RFC 2217, 3)
SERVER_COMMANDS: Final = {
    101: "baudrate",
    102: "datasize",
    103: "parity",
    104: "stopsize",
    105: "control",
}
TITLES: Final = {
    "baudrate": "baud rate",
    "datasize": "data bits",
    "parity": "parity",
    "stopsize": "stop bits",
    "control": "flow control",
}
PARITIES: Final = {1: "none", 2: "odd", 3: "even", 4: "mark", 5: "space"}
STOP_BITS: Final = {1: "1", 2: "2", 3: "1.5"}
CONTROLS: Final = {1: "none", 2: "XON/XOFF", 3: "RTS/CTS"}
IGNORE_CONTROL: Final = "ign_set_control"
_OPTION: Final = re.compile(r"option '(\w+)'")


class ServerAnswers:
    """The server's last answer to each setting, by pyserial's name for it."""

    def __init__(self, opened: serial.SerialBase) -> None:
        self._answers: dict[str, int] = {}
        process: Callable[[bytes], None] | None = getattr(
            opened, "_telnet_process_subnegotiation", None
        )  # in every pyserial release so far
        if process is None:
            return

        def keep(suboption: bytes) -> None:
            data = bytes(suboption)
            name = SERVER_COMMANDS.get(data[1]) if len(data) > 2 else None
            if name is not None:
                self._answers[name] = int.from_bytes(data[2:6], "big")
            process(suboption)

        # pyserial looks it up for each answer
        opened._telnet_process_subnegotiation = keep  # type: ignore[attr-defined]

    def problem(self, url: str, line: LineFormat, error: BaseException) -> str | None:
        """Say which setting the server did not take, and the next step; None if `error` is about
        something else.
        """
        match = _OPTION.search(str(error))
        name = match[1] if match is not None else self._differing(line)
        if name not in TITLES:
            return None
        answer = self._answers.get(name)
        answered = "did not answer" if answer is None else f"answered {_shown(name, answer)}"
        text = (
            f"{url}: the rfc2217 server does not take the line settings: {TITLES[name]}"
            f" {_asked(name, line)} was asked, it {answered}"
        )
        if name == "control":
            joined = "&" if "?" in url else "?"
            return (
                f"{text}; add `{joined}{IGNORE_CONTROL}` to the url: {url}{joined}{IGNORE_CONTROL}"
            )
        return f"{text}; set the server's port to {line}, or let it take the settings of its client"

    def _differing(self, line: LineFormat) -> str | None:
        """Return the first setting whose answer is missing or another one, once any came."""
        if not self._answers:
            return None
        for name in TITLES:
            answer = self._answers.get(name)
            if answer is None or _shown(name, answer) != _asked(name, line):
                return name
        return None


def _asked(name: str, line: LineFormat) -> str:
    parities = {"N": "none", "O": "odd", "E": "even"}
    asked = {
        "baudrate": str(line.baudrate),
        "datasize": "8",
        "parity": parities[line.parity],
        "stopsize": f"{line.stop_bits:g}",
        "control": "none",
    }
    return asked[name]


def _shown(name: str, answer: int) -> str:
    tables = {"parity": PARITIES, "stopsize": STOP_BITS, "control": CONTROLS}
    return tables.get(name, {}).get(answer, str(answer))


def silence_reader(opened: serial.SerialBase) -> None:
    """Silence the reader thread of pyserial's rfc2217, which prints a traceback when the server is
    gone.
    """
    loop = getattr(opened, "_telnet_read_loop", None)  # in every pyserial release so far
    if loop is None:
        return

    def read_on() -> None:
        with contextlib.suppress(*BROKEN):
            loop()

    opened._telnet_read_loop = read_on  # type: ignore[attr-defined]  # pyserial looks it up on opening


def limit_queue(opened: serial.SerialBase) -> Callable[[], None]:
    """Limit the receive queue of pyserial's rfc2217, which its thread fills without bound; return a
    function that removes the limit on closing.

    Otherwise the thread would wait forever on a full queue.
    """
    queue = getattr(opened, "_read_buffer", None)  # in every pyserial release so far
    if not isinstance(queue, Queue):
        return lambda: None
    queue.maxsize = MOST_WAITING

    def remove_limit() -> None:
        with queue.mutex:
            queue.maxsize = sys.maxsize
            queue.not_full.notify_all()

    return remove_limit
