"""Hundreds of ports in one process, and descriptors that select() cannot watch."""

from __future__ import annotations

import contextlib
import os
import resource
from collections.abc import Iterator

import pytest

from support.links.far_ends import Terminal, terminal
from support.product import (
    BESIDE,
    EACH_PORT,
    LineFormat,
    LinkError,
    UsageError,
    allow_ports,
    open_port,
)

LINE = LineFormat()
MANY = 300


@contextlib.contextmanager
def _soft_limit(limit: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_room_is_made_for_many_ports() -> None:
    with _soft_limit(256):
        allow_ports(MANY)
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == MANY * EACH_PORT + BESIDE


def test_a_limit_that_is_high_enough_is_left_alone() -> None:
    with _soft_limit(1024):
        allow_ports(4)
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == 1024


def test_a_hard_limit_is_said_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (1024, 1024))
    with pytest.raises(
        UsageError,
        match=r"5000 ports need \d+ open files .* only 1024; .*ulimit -Hn \d+.*LimitNOFILE=\d+",
    ):
        allow_ports(5000)


def test_a_system_that_refuses_is_said_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (256, resource.RLIM_INFINITY))
    monkeypatch.setattr(resource, "setrlimit", lambda *_: _refuse())
    with pytest.raises(UsageError, match="open files"):
        allow_ports(5000)


def _refuse() -> None:
    raise ValueError("current limit exceeds maximum limit")


@pytest.mark.skipif(
    resource.getrlimit(resource.RLIMIT_NOFILE)[1] < 2048,
    reason="the hard limit on open files is below 2048",
)
def test_300_ports_beyond_descriptor_1023() -> None:
    with _soft_limit(2048), contextlib.ExitStack() as stack:
        for _ in range(1024):  # fill the numbers that select() can watch
            stack.callback(os.close, os.open("/dev/null", os.O_RDONLY))
        _talk_on(stack, [stack.enter_context(terminal()) for _ in range(MANY)])


def _talk_on(stack: contextlib.ExitStack, fars: list[Terminal]) -> None:
    ports = [open_port(far.url, LINE) for far in fars]
    for port in ports:
        stack.callback(port.close)
    descriptors = [port.fileno() for port in ports]
    assert min(number for number in descriptors if number is not None) > 1023
    assert len(set(descriptors)) == MANY
    for number, (far, port) in enumerate(zip(fars, ports, strict=True)):
        port.write(b"question %d" % number)
        # select() could not wait for this one either
        assert os.read(far.far, 100) == b"question %d" % number
        far.say(b"answer %d" % number)
    for number, port in enumerate(ports):
        assert port.read(1.0) == b"answer %d" % number


def test_no_descriptor_left_is_said_with_what_to_do() -> None:
    with terminal() as far, contextlib.ExitStack() as stack, _soft_limit(256):
        with contextlib.suppress(OSError):
            while True:
                stack.callback(os.close, os.open("/dev/null", os.O_RDONLY))
        with pytest.raises(LinkError, match="ulimit -n"):
            open_port(far.url, LINE)
