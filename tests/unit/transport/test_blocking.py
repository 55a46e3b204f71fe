"""The plain loop that pulls one session on one port: what every driver means."""

from __future__ import annotations

import time

import pytest

from jbclog.core.errors import LinkError
from jbclog.core.io_requests import (
    IoResult,
    ask,
    listen,
    reopen,
    wait,
)
from jbclog.transport import blocking
from support.links.near_ends import PairPort, ThreadedPort

KINDS = pytest.mark.parametrize("kind", [PairPort, ThreadedPort], ids=["descriptor", "thread"])


@KINDS
def test_it_does_what_is_wished_and_gives_what_the_session_returns(kind: type[PairPort]) -> None:
    async def session() -> bytes:
        await wait(0.0)
        await reopen()
        return (await ask(b"abc", 5.0)).data

    port = kind()
    assert blocking.run(session(), lambda: port, sleep=time.sleep) == b"cba"
    assert port.is_closed


def test_patience_ends() -> None:
    async def session() -> IoResult:
        await reopen()
        return await ask(b"abc", 0.05)

    heard = blocking.run(session(), lambda: PairPort(lambda question: b""), sleep=time.sleep)
    assert heard.data == b""
    assert 0.05 <= heard.now - heard.sent < 10


@KINDS
def test_what_came_during_a_wait_is_no_answer_to_the_next_question(kind: type[PairPort]) -> None:
    port = kind()

    async def session() -> list[bytes]:
        await reopen()
        port.far.send(b"duplicate")
        unasked = (await wait(0.0)).data
        return [unasked, (await ask(b"abc", 5.0)).data, (await listen(0.0)).data]

    assert blocking.run(session(), lambda: port, sleep=time.sleep) == [b"duplicate", b"cba", b""]


@KINDS
def test_a_broken_link_is_thrown_where_it_is_met(kind: type[PairPort]) -> None:
    ports = [kind(), kind()]
    opened = iter(ports)

    async def session() -> str:
        try:
            await ask(b"abc", 5.0)
        except LinkError as error:
            told = str(error)
        await reopen()
        ports[0].unplug()
        await wait(0.0)
        try:
            await ask(b"abc", 5.0)
        except LinkError:
            await reopen()
        return f"{told}, then {(await ask(b'abc', 5.0)).data.decode()}"

    assert (
        blocking.run(session(), lambda: next(opened), sleep=time.sleep)
        == "the port is not open, then cba"
    )
    assert [port.is_closed for port in ports] == [True, True]


def test_the_port_is_given_back_whatever_happens() -> None:
    port = PairPort()

    async def session() -> None:
        await reopen()
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        blocking.run(session(), lambda: port, sleep=time.sleep)
    assert port.is_closed
