"""A bare pyserial program on the same stations: no decoding, no checks, no rows, no file.

It is the baseline: its cost is the cost of asking, and its rate is what the serial link and the
virtual stations allow.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field

from common import HZ, LINE, cpu_s, percentile

import serial
from jbclog.protocol.client.robot import Station
from jbclog.protocol.commands.family import FAMILIES

FOUR = ("tip_temperature", "power", "status", "alarm_flags")
ANSWER_BYTES = 16
TIMEOUT_S = 1.0
START_S = 1.0  # from opening the ports to the first tick


def frames(port: int = 1) -> list[bytes]:
    """The four questions, as the product asks them."""
    station, commands = Station(LINE), FAMILIES["dde"].commands
    return [station.question(commands[name], port).frame for name in FOUR]


@dataclass(slots=True)
class Asked:
    """The results of one loop: duration of its exchanges, and lateness of each tick."""

    took_s: list[float] = field(default_factory=list)
    late_s: list[float] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Measured:
    """A bare program's run."""

    began: float  # monotonic seconds
    seconds: float
    exchanges: int
    cpu_us: float  # per exchange, all threads
    shortest_s: float
    late_ms: tuple[float, float, float]  # 50 %, 99 %, the latest
    ticks_skipped: int = 0


def opened(url: str) -> serial.Serial:
    return serial.Serial(url, LINE.baudrate, timeout=TIMEOUT_S, exclusive=True)


def ask(port: serial.Serial, question: bytes) -> float:
    """Make one exchange; return its seconds."""
    sent = time.monotonic()
    port.write(question)
    answer = port.read(ANSWER_BYTES)
    took = time.monotonic() - sent
    if len(answer) != ANSWER_BYTES:
        raise RuntimeError(f"{port.port}: {answer!r} is no answer to {question!r}")
    return took


def loop(url: str, seconds: float) -> Measured:
    """Ask one station the four questions repeatedly, without pause."""
    questions, asked = frames(), Asked()
    with opened(url) as port:
        ask(port, questions[0])
        began, before = time.monotonic(), cpu_s()
        while time.monotonic() - began < seconds:
            asked.took_s += [ask(port, question) for question in questions]
        return _measured([asked], began, time.monotonic() - began, cpu_s() - before)


def threads(urls: list[str], seconds: float) -> Measured:
    """One thread per station; each asks the four questions at each tick of a common grid."""
    ports = [opened(url) for url in urls]
    t0 = time.monotonic() + START_S
    asked = [Asked() for _ in ports]
    end = t0 + seconds
    workers = [
        threading.Thread(target=_on_grid, args=(port, t0, end, one))
        for port, one in zip(ports, asked, strict=True)
    ]
    for worker in workers:
        worker.start()
    time.sleep(t0 - time.monotonic())
    before = cpu_s()
    for worker in workers:
        worker.join()
    cpu = cpu_s() - before
    for port in ports:
        port.close()
    return _measured(asked, t0, seconds, cpu)


def _on_grid(port: serial.Serial, t0: float, end: float, asked: Asked) -> None:
    questions, tick = frames(), 0
    while (due := t0 + tick / HZ) < end:
        time.sleep(max(due - time.monotonic(), 0.0))
        asked.late_s.append(time.monotonic() - due)
        asked.took_s += [ask(port, question) for question in questions]
        tick = max(tick + 1, int((time.monotonic() - t0) * HZ))


def _measured(asked: list[Asked], began: float, seconds: float, cpu: float) -> Measured:
    took = [one for each in asked for one in each.took_s]
    late = [one * 1000 for each in asked for one in each.late_s] or [0.0]
    return Measured(
        began=began,
        seconds=seconds,
        exchanges=len(took),
        cpu_us=cpu / len(took) * 1e6,
        shortest_s=min(took),
        late_ms=(percentile(late, 50), percentile(late, 99), max(late)),
        ticks_skipped=sum(round(seconds * HZ) - len(each.late_s) for each in asked if each.late_s),
    )
