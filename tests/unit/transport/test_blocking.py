"""The plain loop that pulls one session on one port: what every driver means."""

from __future__ import annotations

import time

import pytest

from jbclog.core.errors import LinkError
from jbclog.core.io_requests import Ask, IoResult, Listen, Reopen, Steps, Wait
from jbclog.transport import blocking
from support.links.near_ends import PairPort, ThreadedPort

KINDS = pytest.mark.parametrize("kind", [PairPort, ThreadedPort], ids=["descriptor", "thread"])


@KINDS
def test_it_does_what_is_wished_and_gives_what_the_session_returns(kind: type[PairPort]) -> None:
    def session() -> Steps[bytes]:
        yield Wait(0.0)
        yield Reopen()
        return (yield Ask(b"abc", 5.0)).data

    port = kind()
    assert blocking.run(session(), lambda: port, sleep=time.sleep) == b"cba"
    assert port.is_closed


def test_patience_ends() -> None:
    def session() -> Steps[IoResult]:
        yield Reopen()
        return (yield Ask(b"abc", 0.05))

    heard = blocking.run(session(), lambda: PairPort(lambda question: b""), sleep=time.sleep)
    assert heard.data == b""
    assert 0.05 <= heard.now - heard.sent < 10


@KINDS
def test_what_came_during_a_wait_is_no_answer_to_the_next_question(kind: type[PairPort]) -> None:
    port = kind()

    def session() -> Steps[list[bytes]]:
        yield Reopen()
        port.far.send(b"duplicate")
        unasked = (yield Wait(0.0)).data
        return [unasked, (yield Ask(b"abc", 5.0)).data, (yield Listen(0.0)).data]

    assert blocking.run(session(), lambda: port, sleep=time.sleep) == [b"duplicate", b"cba", b""]


@KINDS
def test_a_broken_link_is_thrown_where_it_is_met(kind: type[PairPort]) -> None:
    ports = [kind(), kind()]
    opened = iter(ports)

    def session() -> Steps[str]:
        try:
            yield Ask(b"abc", 5.0)
        except LinkError as error:
            told = str(error)
        yield Reopen()
        ports[0].unplug()
        yield Wait(0.0)
        try:
            yield Ask(b"abc", 5.0)
        except LinkError:
            yield Reopen()
        return f"{told}, then {(yield Ask(b'abc', 5.0)).data.decode()}"

    assert (
        blocking.run(session(), lambda: next(opened), sleep=time.sleep)
        == "the port is not open, then cba"
    )
    assert [port.is_closed for port in ports] == [True, True]


def test_the_port_is_given_back_whatever_happens() -> None:
    port = PairPort()

    def session() -> Steps[None]:
        yield Reopen()
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        blocking.run(session(), lambda: port, sleep=time.sleep)
    assert port.is_closed
