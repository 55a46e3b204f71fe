"""What one port may give at a time: a port that never falls silent costs neither memory nor the
others' time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest

from jbclog.core.io_requests import (
    IoResult,
    ask,
    listen,
    reopen,
    wait,
)
from jbclog.transport import blocking
from jbclog.transport.port import MOST_AT_ONCE, MOST_KEPT, MOST_READS, REST_S, Budget
from jbclog.transport.reactor import Reactor
from support.links.near_ends import PairPort, ThreadedPort

every_kind = pytest.mark.parametrize("kind", [PairPort, ThreadedPort])
every_piece = pytest.mark.parametrize(
    "piece", [b"x", b"\x020100ATT100077\x03\x52" * 500], ids=["single bytes", "whole kilobytes"]
)


@contextmanager
def flooding(port: PairPort, piece: bytes) -> Iterator[None]:
    """Send on the far end whenever there is room."""
    is_over = threading.Event()
    far = port.far.dup()  # the driver closes both ends
    far.settimeout(0.1)

    def send() -> None:
        with suppress(BrokenPipeError, ConnectionError):  # the near end is closed
            while not is_over.is_set():
                with suppress(TimeoutError):
                    far.send(piece)

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
        far.close()


def test_answers_in_pieces_of_a_byte_are_never_made_to_rest() -> None:
    budget = Budget()
    for _ in range(100):
        budget.reads = 0
        assert not any(budget.is_spent(1) for _ in range(MOST_READS))
    assert budget.is_spent(1)
    assert budget.is_spent(MOST_AT_ONCE)


@every_kind
@every_piece
def test_what_comes_in_a_wait_is_bounded(kind: type[PairPort], piece: bytes) -> None:
    port, heard = kind(lambda _: b""), list[IoResult]()

    async def session() -> None:
        now = (await reopen()).now
        # the thread that floods may be late
        while sum(bool(one.data) for one in heard) < 3 and len(heard) < 200:
            heard.append(await wait(now + 0.3))
            now = heard[-1].now

    reactor = Reactor()
    reactor.add(session(), lambda: port)
    with flooding(port, piece):
        reactor.run()
    assert max(len(one.data) for one in heard) <= MOST_KEPT + MOST_AT_ONCE
    assert sum(bool(one.data) for one in heard) == 3  # it is read again after each


@every_kind
@every_piece
def test_a_listener_is_told_some_twenty_times_a_second_and_its_neighbour_at_once(
    kind: type[PairPort], piece: bytes
) -> None:
    flooded, other = kind(lambda _: b""), PairPort()
    told: list[float] = []
    waited: list[float] = []

    async def listening() -> None:
        begun = (await reopen()).now
        while (heard := await listen(begun + 1.0)).now < begun + 1.0:
            told.append(heard.now)

    async def asking() -> None:
        begun = now = (await reopen()).now
        while now < begun + 1.0:
            heard = await ask(b"question", 1.0)
            waited.append(heard.now - heard.sent)
            now = (await wait(heard.now + 0.01)).now

    reactor = Reactor()
    reactor.add(listening(), lambda: flooded)
    reactor.add(asking(), lambda: other)
    with flooding(flooded, piece):
        reactor.run()
    assert len(told) <= MOST_READS + 1.0 / REST_S + 5
    assert sorted(waited)[len(waited) // 2] < REST_S / 2  # it waits for no rest of the other


def test_answers_come_again_once_the_flood_is_over() -> None:
    port, answers = PairPort(), list[bytes]()

    async def session() -> None:
        now = (await reopen()).now
        with flooding(port, b"x" * 4096):
            now = (await wait(now + 0.3)).now
        while (heard := await listen(now + 0.3)).data:
            now = heard.now
        answers.append((await ask(b"abc", 2.0)).data)

    reactor = Reactor()
    reactor.add(session(), lambda: port)
    reactor.run()
    assert answers == [b"cba"]


def test_a_thread_of_its_own_rests_too() -> None:
    """Or the threads of the other stations would wait for their turn."""
    port, told = PairPort(lambda _: b""), list[float]()

    async def session() -> None:
        begun = now = (await reopen()).now
        while now < begun + 0.6 or len(told) < 3:  # the thread that floods may be late
            heard = await listen(now + 0.6)
            now = heard.now
            if heard.data:
                told.append(now - begun)

    with flooding(port, b"x" * 4096):
        blocking.run(session(), lambda: port, sleep=time.sleep)
    # each was told some time after it was read, so that two may follow each other quickly
    assert len(told) <= told[-1] / REST_S + 1.5
