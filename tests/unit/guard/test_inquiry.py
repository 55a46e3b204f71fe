"""`jbclog safe` asks a guard at work; and what a recorder sends of its stations' identities."""

from __future__ import annotations

import os
import select
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from support.product import (
    ANSWERED_AT_ONCE,
    GuardProcess,
    Inquiries,
    Inquiry,
    PortDevice,
    Proof,
    Unsafe,
    Watch,
    answer_inquiry,
)

UNSAFE = Unsafe("ucr-1", "/dev/ttyUSB0", {1: "stand was ordered 3 times"}, 3, None)


def test_a_question_gets_the_result_and_the_guard_waits_until_it_is_closed(tmp_path: Path) -> None:
    with Inquiries(tmp_path) as inquiries:
        asked = Inquiry(tmp_path)
        assert asked.is_at_work
        asking = inquiries.wait(5.0)
        assert asking is not None
        resumed = threading.Event()

        def work() -> None:
            answer_inquiry(asking, [UNSAFE])
            resumed.set()

        threading.Thread(target=work, daemon=True).start()
        assert asked.answer() == (UNSAFE,)
        assert not resumed.wait(0.1)
        asked.close()
        assert resumed.wait(5.0)
        assert inquiries.wait(0.0) is None


def test_without_a_guard_nobody_is_waited_for(tmp_path: Path) -> None:
    asked = Inquiry(tmp_path)
    assert (asked.is_at_work, asked.answer()) == (False, ())
    asked.close()


def test_a_guard_that_ends_meanwhile_leaves_the_ports(tmp_path: Path) -> None:
    with Inquiries(tmp_path):
        asked = Inquiry(tmp_path)
    assert asked.answer() == ()
    asked.close()


def test_a_second_guard_of_a_run_is_not_asked(tmp_path: Path) -> None:
    with Inquiries(tmp_path), Inquiries(tmp_path) as second:
        assert second.wait(0.0) is None


# -- the recorder's side ---------------------------------------------------------------------------


def proof(name: str, answered_at: float = 1.0) -> Proof:
    return Proof(name, PortDevice(number=7), answered_at, {1: (0, 0, 0, 0, 0)})


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reading, writing = os.pipe()
    os.set_blocking(reading, False)
    os.set_blocking(writing, False)
    yield reading, writing
    os.close(reading)
    os.close(writing)


def process(writing: int) -> GuardProcess:
    """One that is never started: only its pipe is used."""
    made = object.__new__(GuardProcess)
    made._families, made._proofs, made._pipe = (), {}, writing
    return made


def taken(reading: int, watch: Watch) -> bytes:
    try:
        data = os.read(reading, 1 << 20)
    except BlockingIOError:
        return b""
    watch.hear(data, 0.0)
    return data


def test_only_what_changed_is_sent(pipe: tuple[int, int]) -> None:
    reading, writing = pipe
    guard, watch = process(writing), Watch(0.0)
    stations = {f"ucr-{number}": proof(f"ucr-{number}") for number in range(ANSWERED_AT_ONCE + 1)}
    guard.identify(("ucr",), stations)
    taken(reading, watch)
    assert (watch.continuity.families, watch.continuity.proofs) == (("ucr",), stations)
    soon = {name: replace(known, answered_at=1.5) for name, known in stations.items()}
    guard.identify(("ucr",), soon)
    assert taken(reading, watch) == b""
    later = {name: replace(known, answered_at=2.0) for name, known in stations.items()}
    guard.identify(("ucr",), later)
    lines = taken(reading, watch).splitlines()
    assert len(lines) == 2
    assert max(map(len, lines)) < select.PIPE_BUF
    assert watch.continuity.proofs == later
    resting = later | {"ucr-1": replace(later["ucr-1"], statuses={1: (0, 0, 0, 0, 1)})}
    guard.identify(("ucr",), resting)
    assert len(taken(reading, watch).splitlines()) == 1
    assert watch.continuity.proofs == resting
    del resting["ucr-0"]
    guard.identify(("ucr",), resting)
    taken(reading, watch)
    assert watch.continuity.proofs == resting


def test_what_a_full_pipe_does_not_take_is_sent_later(pipe: tuple[int, int]) -> None:
    reading, writing = pipe
    with suppress(BlockingIOError):
        while True:
            os.write(writing, b"\n" * 4096)
    guard, watch = process(writing), Watch(0.0)
    guard.identify(("ucr",), {"ucr-1": proof("ucr-1")})
    while taken(reading, watch):
        pass
    assert watch.continuity.proofs == {}
    guard.identify(("ucr",), {"ucr-1": proof("ucr-1")})
    taken(reading, watch)
    assert watch.continuity.proofs == {"ucr-1": proof("ucr-1")}
    assert watch.continuity.families == ("ucr",)
