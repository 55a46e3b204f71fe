"""What is a flood and what is none: bytes and moments only."""

from __future__ import annotations

import random

import pytest

from support.product import (
    FLOOD_QUIET_S,
    LEAST_DUE,
    MOST_TIMES,
    SUSPECT_BYTES,
    FloodDetector,
    IoResult,
    LineFormat,
    LinkError,
    LinkFlooded,
    Station,
    Steps,
    Wait,
    expect_quiet,
    pull,
    send,
)


def fed(
    bytes_per_s: float, due_per_s: float, seconds: float = 3.0, every_s: float = 0.1
) -> FloodDetector:
    """A flow that was told of so much, at even distances."""
    flow = FloodDetector()
    for step in range(round(seconds / every_s) + 1):
        flow.came(100 + step * every_s, round(bytes_per_s * every_s), round(due_per_s * every_s))
        if flow.found is not None:
            break
    return flow


@pytest.mark.parametrize("due_per_s", [100, 1000, 20_000])
@pytest.mark.parametrize(
    ("times", "is_flood"), [(1.0, False), (9.5, False), (10.5, True), (1000.0, True)]
)
def test_more_than_ten_times_what_is_due_is_a_flood(
    due_per_s: float, times: float, is_flood: bool
) -> None:
    flow = fed(times * due_per_s, due_per_s)
    assert (flow.found is not None, flow.is_flooded) == (is_flood, is_flood)


@pytest.mark.parametrize(
    ("baudrate", "due_per_s", "is_flood"),
    [(1200, 0, False), (2400, 0, True), (19200, 160, True), (19200, 200, False)],
)
def test_a_slow_link_that_is_never_silent_is_one_where_little_is_asked(
    baudrate: int, due_per_s: float, is_flood: bool
) -> None:
    flow = fed(baudrate / 10, due_per_s)
    assert flow.is_flooded is is_flood


def test_the_error_says_how_much_came_and_how_much_was_due() -> None:
    flow = fed(5000, 50)
    error = flow.taken()
    assert isinstance(error, LinkError)
    assert error.reason == "disconnected"
    assert (error.came, error.limit, error.seconds) == (5500, 550, pytest.approx(1.0))
    assert (
        "at least 5500 bytes came in 1.0 s, answers of 55 bytes were due (limit: 550 bytes)"
        in str(error)
    )


def test_it_is_taken_once_and_another_second_has_to_pass_for_the_next() -> None:
    flow = fed(5000, 0)
    flow.taken()
    assert flow.found is None
    assert flow.is_flooded
    flow.came(200.0, 500)
    flow.came(200.9, 500)
    assert flow.found is None
    flow.came(201.0, 0)
    assert flow.found is not None


def test_answers_that_are_late_may_come_all_at_once_and_no_more_than_they() -> None:
    """A station that was stuck answers forty questions of four seconds within one."""
    for more, is_flood in ((0, False), (MOST_TIMES * 200, True)):
        flow = FloodDetector()
        for tenth in range(40):
            flow.came(100 + tenth / 10, 0, 16)
        flow.came(104.0, 0)
        flow.came(105.0, 40 * 16 + more)  # nothing more was asked meanwhile
        assert flow.is_flooded is is_flood, more


def test_a_quiet_second_ends_it() -> None:
    flow = fed(5000, 0)
    flow.taken()
    flow.came(200.0, 15, 15)
    flow.came(201.0, 15, 15)
    assert (flow.is_flooded, flow.found) == (False, None)


def test_a_long_wait_is_reckoned_by_its_length() -> None:
    """Nothing is told while a session waits: a hundred bytes a second for a minute are none, a
    thousand are.
    """
    for bytes_per_s, is_flood in ((100, False), (1000, True)):
        flow = FloodDetector()
        flow.came(0.0, 0)
        flow.came(60.0, 60 * bytes_per_s)
        assert flow.is_flooded is is_flood


def test_no_answer_is_believed_among_more_than_half_a_kilobyte_that_was_not_due() -> None:
    flow = FloodDetector()
    assert not flow.came(0.0, SUSPECT_BYTES, 15)
    assert flow.came(0.1, 1, 15)
    assert not flow.came(0.2, 0, SUSPECT_BYTES // MOST_TIMES)


@pytest.mark.parametrize(
    ("came", "is_flooded"), [(round(MOST_TIMES * LEAST_DUE * FLOOD_QUIET_S), False), (100, True)]
)
def test_a_link_that_was_flooded_is_listened_to_before_anything_is_asked(
    came: int, is_flooded: bool
) -> None:
    client = Station(LineFormat())
    client.now = 50.0
    client.flow.is_flooded = True
    steps: Steps[None] = expect_quiet(client)
    assert pull(steps) == Wait(50.0 + FLOOD_QUIET_S)
    with pytest.raises(LinkFlooded if is_flooded else StopIteration):
        send(steps, IoResult(50.0 + FLOOD_QUIET_S, bytes(came), 0.0))
    assert client.flow.is_flooded is is_flooded
    assert client.flow.found is None


@pytest.mark.parametrize("seed", range(20))
def test_answers_in_order_may_be_added_without_a_call(seed: int) -> None:
    """Answers among noise, late ones, floods and silence, told in both ways."""
    chance = random.Random(seed)
    told, added = FloodDetector(), FloodDetector()
    now, short = 100.0, 0
    for _ in range(3000):
        now += chance.choice([0.001, 0.014, 0.05, 0.3])
        if chance.random() < 0.9:
            told.came(now, 18, 18)
            if now < added.quiet_until:
                added.in_order += 18
                short += 1
            else:
                added.came(now, 18, 18)
        else:
            size, due = chance.choice([0, 5, 100, 600, 6000]), chance.choice([0, 13, 18])
            assert told.came(now, size, due) == added.came(now, size, due)
        assert told.is_suspect == added.is_suspect
        assert told.is_flooded == added.is_flooded
        assert str(told.found) == str(added.found)
        if told.found is not None and chance.random() < 0.5:
            told.taken()
            added.taken()
        elif chance.random() < 0.01:
            told.calm()
            added.calm()
    assert short > 300
