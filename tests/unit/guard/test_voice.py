"""What a guard says: never waited for, and nothing in it steers a terminal."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress

import pytest

from support import product
from support.product import close_stream, patch, show_by_guard


@pytest.fixture
def reading(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The other end of what is its stderr here."""
    reading, writing = os.pipe()
    patch(monkeypatch, "action_log.STDERR", writing)
    yield reading
    os.close(reading)
    os.close(writing)


def test_a_line_is_said_without_what_steers_a_terminal(reading: int) -> None:
    show_by_guard("dde-1: \x1b[2J\rthe tool \x07was told – 350 °C")
    assert (
        os.read(reading, 4096).decode() == "jbclog guard: dde-1: �[2J the tool �was told – 350 °C\n"
    )


def test_nobody_who_reads_is_waited_for(reading: int) -> None:
    os.set_blocking(product.GUARD_STDERR, False)
    with suppress(BlockingIOError):
        while True:
            os.write(product.GUARD_STDERR, b"x" * 4096)
    os.set_blocking(product.GUARD_STDERR, True)
    show_by_guard("text")  # or it would wait for ever


def test_a_stderr_that_is_closed_or_hung_up_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    for end in (0, 1):
        ends = os.pipe()
        os.close(ends[end])
        patch(monkeypatch, "action_log.STDERR", ends[1])
        show_by_guard("text")
        os.close(ends[1 - end])


def test_who_reads_comes_to_the_end(reading: int) -> None:
    show_by_guard("first")
    close_stream(product.GUARD_STDERR)
    show_by_guard("second")
    assert os.read(reading, 4096) == b"jbclog guard: first\n"
    assert os.read(reading, 4096) == b""
