"""The program that `bench_instructions.py` counts: ``python instructions.py PART EXCHANGES
[PIECES]`` makes that many exchanges, with answers in that many pieces, and ends.
"""

from __future__ import annotations

import gc
import os
import sys
import tempfile
from collections.abc import Callable, Generator
from pathlib import Path
from typing import NamedTuple

from common import RECIPE

from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.app.run.tasks import station_tasks
from jbclog.core.clock import UtcOffset, VirtualClock
from jbclog.core.io_requests import Ask, IoResult, Listen, Wait, ask, listen, reopen
from jbclog.core.rows import CounterRow, EventRow, SampleRow, SettingRow, StationFacts
from jbclog.session.run.context import SessionContext
from jbclog.session.run.station_run import run_station
from jbclog.sim.setup import virtual_station
from jbclog.transport.reactor import Reactor

LINE = (
    '[line]\nname = "bench"\n[[station]]\nname = "dde-1"\nurl = "nowhere"\nfamily = "dde"\nports ='
    " [1]\n"
)
EXCHANGE_S = 0.0141
LEARNING_S, KNOWN_S = 8.0, 10.0  # from the first tick: answers are recorded, then replayed
QUESTION, ANSWER = b"\x020001RTT1\x03\x25", b"\x020100ATT100350\x03\x14"


class Nobody:
    """A journal that stores nothing."""

    def sample(self, row: SampleRow) -> None: ...
    def counter(self, row: CounterRow) -> None: ...
    def setting(self, row: SettingRow) -> None: ...
    def event(self, row: EventRow, *, at_once: bool = False) -> None: ...
    def facts(self, facts: StationFacts) -> None: ...


def in_pieces(data: bytes, pieces: int) -> list[bytes]:
    """Split `data` into that many pieces, the longer ones first, at least one byte each."""
    size = -(-len(data) // pieces)
    return [data[begin : begin + size] for begin in range(0, len(data), size)]


def session(exchanges: int, pieces: int) -> None:
    """A session that samples at 10 Hz without any driver, on recorded answers of its virtual
    station.
    """
    with tempfile.TemporaryDirectory() as name:
        line, recipe = Path(name, "line.toml"), Path(name, "recipe.toml")
        line.write_text(LINE)
        recipe.write_text(RECIPE.format(hz=10, alarms_every_s=0.2))
        plan = make_plan(RunOptions(line, recipe, duration_s=1e9))
    clock = VirtualClock()
    (task,) = station_tasks(plan, clock.monotonic())
    context = SessionContext.of(task, Nobody(), UtcOffset(clock))
    peer = virtual_station(plan.stations[0].spec, now=clock.monotonic())
    steps, known = run_station(context), dict[bytes, list[bytes]]()
    now = clock.monotonic()
    begun, sent, done, heard = float("inf"), now, 0, IoResult(now, b"", now)
    request, coming = steps.send(None), list[bytes]()
    while done < exchanges:
        data = b""
        if isinstance(request, Ask):
            sent, now = now, now + EXCHANGE_S
            if sent > begun + KNOWN_S and request.data in known:
                data, *coming = known[request.data]
                done += 1
            else:
                data = b"".join(piece for _, piece in peer.receive(request.data, sent))
                if sent > begun + LEARNING_S:
                    known.setdefault(request.data, in_pieces(data, pieces))
        elif coming:
            data = coming.pop(0)
        elif isinstance(request, Listen | Wait):
            now = max(now, request.until)
        if context.state.facts.first_tick is not None:
            begun = min(begun, now)
        heard = IoResult(now, data, sent)
        request = steps.send(heard)


class Pipe:
    """A port whose other end answers at once; an answer takes that many reads."""

    url = "pipe"

    def __init__(self, pieces: int) -> None:
        self._out, self._into = os.pipe()
        self._most = 1024 if pieces == 1 else len(in_pieces(ANSWER, pieces)[0])

    def fileno(self) -> int:
        return self._out

    def write(self, data: bytes) -> None:
        os.write(self._into, ANSWER)

    def read_now(self) -> bytes:
        return os.read(self._out, self._most)

    def read(self, timeout_s: float) -> bytes:
        return self.read_now()

    def close(self) -> None: ...


def drive(exchanges: int, pieces: int) -> None:
    """The reactor with a session that only asks, and waits for the rest of an answer."""

    async def steps() -> None:
        await reopen()
        for _ in range(exchanges):
            heard = await ask(QUESTION, 0.5)
            for _ in range(1, pieces):
                await listen(heard.sent + 0.5)
        os._exit(0)

    reactor = Reactor()
    reactor.add(steps(), lambda: Pipe(pieces))
    reactor.run()


class _Answer(NamedTuple):
    now: float
    data: bytes


class _Meter:
    """Attributes, conditions and calls like those of a session."""

    def __init__(self) -> None:
        self.came = self.asked = 0
        self.begun: float | None = None
        self.known: dict[bytes, tuple[str, int]] = {}
        self.last = ""

    def ask(self) -> bytes:
        self.asked += 1
        if self.asked > 10**9 and self.last:
            raise ValueError(self.last)
        return QUESTION

    def hear(self, answer: _Answer) -> int:
        self.came += len(answer.data)
        begun = self.begun
        if begun is None or answer.now - begun >= 1.0:
            self.begun = answer.now
        known = self.known.get(answer.data) or self._learn(answer.data)
        self.last, value = known
        return value

    def _learn(self, data: bytes) -> tuple[str, int]:
        self.known[data] = found = data[9:14].decode(), int(data[9:14])
        return found


def yardstick(exchanges: int, _pieces: int) -> None:
    """The baseline of both: a small program of the same kind. Do not change it."""

    def ask(meter: _Meter, row: list[int]) -> Generator[bytes, _Answer, None]:
        while True:
            answer = yield meter.ask()
            value = meter.hear(answer)
            if value > 300 and row[0] != value:
                row[0] = value

    def session() -> Generator[bytes, _Answer, None]:
        yield from ask(_Meter(), [0])

    steps, now = session(), 0.0
    next(steps)
    for _ in range(10 * exchanges):
        now += 0.0141
        steps.send(_Answer(now, ANSWER))


PARTS: dict[str, Callable[[int, int], None]] = {
    "session": session,
    "drive": drive,
    "yardstick": yardstick,
}

if __name__ == "__main__":
    gc.disable()
    PARTS[sys.argv[1]](int(sys.argv[2]), int(*sys.argv[3:] or "1"))
    os._exit(0)
