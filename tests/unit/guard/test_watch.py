"""When the guard takes over, and when it does not: the arithmetic, on made-up time."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.campaigns.slices import first
from support.product import (
    OVERSLEPT_S,
    RECORDER_HUNG_S,
    RENEW_S,
    WATCH_BEAT,
    WATCH_END,
    WATCH_FAILED,
    WATCH_GRACE_S,
    StationLease,
    Verdict,
    Watch,
)


def lease(*ports: int, feeds: bool = False) -> StationLease:
    return StationLease("dde-1", "p", 19200, "8N1", 1, "dde", "DDE", "1.0", "stand", ports, feeds)


def line(text: str) -> bytes:
    return text.encode() + b"\n"


def leased(*ports: int, feeds: bool = False) -> Watch:
    watch = Watch(0.0)
    assert watch.hear(line(lease(*ports, feeds=feeds).to_json()), 1.0)
    return watch


def test_a_lease_comes_back_as_it_was() -> None:
    assert StationLease.from_json(lease(1, 2).to_json()) == lease(1, 2)


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", "7", "beats", '{"name": "x"}', lease(1).to_json()[:-1]]
)
def test_what_is_no_line_of_ours_is_no_sign_of_life(text: str) -> None:
    watch = leased(1)
    assert not watch.hear(line(text), 1.0 + RECORDER_HUNG_S)
    assert watch.verdict(1.1 + RECORDER_HUNG_S, closed=False) is Verdict.HUNG


@pytest.mark.parametrize("held", [lease(1), lease(2, 1), lease(feeds=True)])
def test_a_recorder_that_dies_with_something_hot_is_taken_over_at_once(held: StationLease) -> None:
    watch = Watch(0.0)
    watch.hear(line(held.to_json()), 1.0)
    assert watch.verdict(1.0, closed=True) is Verdict.DEAD


def test_one_that_holds_nothing_may_be_silent_and_may_die() -> None:
    for watch in (Watch(0.0), leased()):
        assert watch.verdict(9999.0, closed=False) is Verdict.WATCH
        assert watch.verdict(9999.0, closed=True) is Verdict.DONE


def test_silence_is_a_hang_from_two_seconds_on() -> None:
    watch = leased(1)
    assert watch.verdict(1.0 + RECORDER_HUNG_S, closed=False) is Verdict.WATCH
    assert watch.verdict(1.001 + RECORDER_HUNG_S, closed=False) is Verdict.HUNG
    watch.hear(line(WATCH_BEAT), 2.9)
    assert watch.verdict(1.001 + RECORDER_HUNG_S, closed=False) is Verdict.WATCH


def test_after_the_end_there_is_nothing_left_to_do() -> None:
    watch = leased(1)
    watch.hear(line(WATCH_END), 2.0)
    assert watch.verdict(99.0, closed=True) is Verdict.DONE


@given(st.lists(st.integers(1, 40), max_size=30))
def test_lines_may_be_cut_anywhere(cuts: list[int]) -> None:
    whole = b"".join(map(line, [lease(1).to_json(), WATCH_BEAT, lease(1, 2).to_json(), WATCH_BEAT]))
    watch, place = Watch(0.0), 0
    for cut in cuts:
        watch.hear(whole[place : place + cut], 1.0)
        place += cut
    watch.hear(whole[place:], 1.0)
    assert watch.stations == {"dde-1": lease(1, 2)}


@given(st.lists(st.floats(0.0, RECORDER_HUNG_S - RENEW_S - 0.01), max_size=200))
def test_no_jitter_of_renewals_up_to_a_second_and_a_half_is_a_hang(late: list[float]) -> None:
    watch, now = leased(1), 1.0
    for by in late:
        now += RENEW_S + by
        assert watch.verdict(now, closed=False) is Verdict.WATCH
        watch.hear(line(WATCH_BEAT), now)


def test_it_looks_again_when_there_is_something_to_decide() -> None:
    watch = leased(1)
    moment = 1.5 + watch.patience_s(1.5)
    assert watch.verdict(moment, closed=False) is Verdict.HUNG
    assert moment < 1.0 + RECORDER_HUNG_S + 0.1


def test_one_that_failed_and_says_so_is_taken_over_if_it_holds_something() -> None:
    for watch, verdict in ((leased(1), Verdict.FAILED), (leased(), Verdict.DONE)):
        watch.hear(line(WATCH_FAILED), 1.5)
        assert watch.verdict(1.5, closed=False) is verdict


def test_silence_that_the_guard_slept_through_itself_is_nobodys_fault() -> None:
    watch = leased(1)
    watch.overslept(OVERSLEPT_S + 10, 13.0)
    assert watch.verdict(13.0 + WATCH_GRACE_S, closed=False) is Verdict.WATCH
    assert watch.verdict(13.1 + WATCH_GRACE_S, closed=False) is Verdict.HUNG
    assert watch.patience_s(13.0) > WATCH_GRACE_S
    # a second is enough for four renewals
    assert watch.verdict(13.9, closed=False) is Verdict.WATCH
    assert watch.verdict(14.1, closed=False) is Verdict.HUNG


def test_a_guard_that_wakes_a_little_late_gives_no_grace() -> None:
    watch = leased(1)
    for late_s in (0.001, 0.25, OVERSLEPT_S):  # on a busy machine it is late each time
        watch.overslept(late_s, 1.1 + RECORDER_HUNG_S)
        assert watch.verdict(1.1 + RECORDER_HUNG_S, closed=False) is Verdict.HUNG


@pytest.mark.parametrize("seed", first(1, range(2)))
def test_a_hundred_hours_of_jitter_are_no_hang(seed: int) -> None:
    """Renewals up to a second and a half late, a guard that wakes up to a second late, every case
    looked at as it comes.
    """
    rng, watch, now, renewals = random.Random(seed), leased(1, feeds=True), 1.0, 0
    while now < 100 * 3600:
        renewal = now + RENEW_S + 1.49 * rng.random() ** 2
        wakes = now + watch.patience_s(now) + rng.choice((0.0, 0.0, rng.random()))
        if wakes < renewal:
            watch.overslept(wakes - now - watch.patience_s(now), wakes)
            assert watch.verdict(wakes, closed=False) is Verdict.WATCH, (seed, now)
        now = renewal
        watch.hear(b"beat\n", now)
        assert watch.verdict(now, closed=False) is Verdict.WATCH, (seed, now)
        renewals += 1
    assert renewals > 250_000
