"""A suspended host and a slow station make the same ticks late; only the first is reported as a
suspended host.
"""

from __future__ import annotations

from contextlib import suppress

import pytest

from support.oracles.account import assert_account_holds
from support.product import (
    COLUMN,
    Ask,
    IoResult,
    LinkError,
    Listen,
    Reopen,
    SkippedTicks,
    Standstill,
    Wait,
    do,
    pull,
    send,
    throw,
)
from support.virtual.lines import fault
from support.virtual.virtual_run import VirtualRun, line_text, prepare

SLOW = (
    'turnaround_ms = 200.0\n[[station.sim.fault]]\nkind = "silence"\nat_s = 60\nfor_s = 60\nevery'
    " = 2\n"
)


def stop_the_host(run: VirtualRun, at_s: float, for_s: float) -> None:
    run.at(at_s, lambda: run.driver.clock.advance_to(run.driver.clock.monotonic() + for_s))


def skipped(run: VirtualRun) -> int:
    return sum(row[COLUMN["quality"]] == "skipped" for row in run.memory.samples)


def test_a_station_that_takes_its_time_is_no_host_that_stood_still() -> None:
    """Every other question has no answer and is repeated, so a tick of four ports takes many
    seconds.
    """
    line = (
        line_text(SLOW)
        .replace("turnaround_ms = 1.0\n", "")
        .replace('family = "dde"', 'family = "dme"')
    )
    run = prepare(line, duration_s=150, rate="fit").go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert run.memory.of_kind("host.suspended") == []
    assert skipped(run) > 0
    assert_account_holds(run)


def test_no_time_of_a_port_steps_back_when_ticks_are_skipped_after_a_late_answer() -> None:
    silence = fault("silence", at_s=5, for_s=4, every=2)
    run = prepare(line_text(silence, "ports = [1, 2]"), duration_s=20, rate=10).go()
    assert skipped(run) > 0
    for port in (1, 2):
        times = run.memory.column("time", port)
        assert run.memory.column("tick", port) == sorted(run.memory.column("tick", port))
        assert times == sorted(times)


def test_a_host_that_stood_still_in_the_middle_of_a_question_is() -> None:
    for at_s in (10.0, 10.003, 10.013, 10.031, 10.05, 10.09):
        run = prepare(duration_s=60)
        stop_the_host(run, at_s, 20)
        run.go()
        (event,) = run.memory.of_kind("host.suspended")
        assert event.value is not None
        assert 19 < event.value < 21
        assert run.facts.skipped > 190
        assert_account_holds(run)


def test_a_host_that_stood_still_in_an_outage_leaves_no_rows_of_it() -> None:
    run = prepare(
        line_text('[[station.sim.fault]]\nkind = "dropout"\nat_s = 8\nfor_s = 120\n'),
        duration_s=200,
    )
    stop_the_host(run, 20, 90)
    run.go()
    (event,) = run.memory.of_kind("host.suspended")
    assert event.value is not None
    assert 80 < event.value < 91
    assert 800 < run.facts.skipped < 910
    assert_account_holds(run)


@pytest.mark.parametrize("end_s", [60, 80.8])
def test_a_run_that_ends_with_the_standstill_of_an_outage_leaves_no_tick_out(end_s: float) -> None:
    """Its last tick is one without a row, or has one: that of a tick behind a standstill in the
    middle of a seek, due before the seek was over.
    """
    for step in range(20):
        run = prepare(
            line_text(fault("silence", at_s=8, for_s=1000), "ports = [1]"), duration_s=end_s
        )
        stop_the_host(run, 20 + 0.1 * step, 60)
        run.go()
        assert len(run.memory.of_kind("host.suspended")) == 1
        assert run.facts.first_tick is not None
        assert run.facts.last_tick is not None
        assert run.facts.last_tick - run.facts.first_tick + 1 == 10 * end_s, step
        assert_account_holds(run)


def test_short_pauses_are_rows() -> None:
    run = prepare(duration_s=60)
    stop_the_host(run, 10, 4.5)
    run.go()
    assert run.memory.of_kind("host.suspended") == []
    assert skipped(run) > 70  # two ports


# -- a busy host -----------------------------------------------------------------------------------


def test_a_busy_host_is_told_with_how_many_ticks_and_how_late() -> None:
    run = prepare(duration_s=60)
    for at_s in (10.0, 12.0, 14.0):
        stop_the_host(run, at_s, 0.45)
    run.go()
    (event,) = run.memory.of_kind("host.busy")
    assert (event.severity, event.station) == ("warning", "dde-1")
    assert event.value == run.facts.skipped_by_host == skipped(run) / 2  # two ports
    assert 9 <= event.value <= 15
    assert "in 3 places" in event.text
    assert 0.3 < float(str(event.raw).removeprefix("late_s=")) < 0.5
    assert event.earliest is not None
    assert 3.5 < (event.time - event.earliest) / 1e6 < 20  # told once it was quiet again
    assert_account_holds(run)


def test_ten_busy_minutes_are_two_events() -> None:
    run = prepare(duration_s=650)
    for at_s in range(20, 620, 5):
        stop_the_host(run, at_s, 0.3)
    run.go()
    events = run.memory.of_kind("host.busy")
    assert 2 <= len(events) <= 3
    assert (
        sum(event.value or 0 for event in events) == run.facts.skipped_by_host == skipped(run) / 2
    )
    assert (run.facts.skipped_by_host or 0) > 115


def test_what_was_skipped_last_is_told_at_the_end() -> None:
    run = prepare(duration_s=20)
    stop_the_host(run, 18.0, 0.45)
    run.go()
    (event,) = run.memory.of_kind("host.busy")
    assert event.value == run.facts.skipped_by_host


def test_a_host_with_time_tells_nothing() -> None:
    run = prepare(duration_s=30).go()
    assert run.memory.of_kind("host.busy") == []
    assert run.facts.skipped_by_host == 0


def test_what_the_station_made_late_is_not_the_hosts() -> None:
    """It leaves questions unanswered: its ticks are late, and the host never is."""
    run = prepare(
        line_text('[[station.sim.fault]]\nkind = "silence"\nat_s = 5\nfor_s = 40\nevery = 20\n'),
        duration_s=60,
    ).go()
    assert skipped(run) > 20
    assert run.facts.skipped_by_host == 0
    assert run.memory.of_kind("host.busy") == []
    events = run.memory.of_kind("station.slow")
    assert sum(event.value or 0 for event in events) == skipped(run) / 2  # two ports
    assert events[0].text.startswith("The station answered slowly or not at all: ")


def test_a_question_that_is_never_answered_costs_ticks_and_an_event_says_so() -> None:
    fault = (
        '[[station.sim.fault]]\nkind = "silence"\nat_s = 0\nfor_s = 3600\ncommand ='
        ' "transformer_temperature"\n'
    )
    run = prepare(line_text(fault), duration_s=20).go()
    (event,) = run.memory.of_kind("station.slow")
    assert (event.severity, event.station) == ("warning", "dde-1")
    assert event.value == skipped(run) / 2 > 0  # two ports
    assert "skipped (one is due every 0.1 s), up to " in event.text
    assert (run.facts.skipped_by_host, run.memory.of_kind("host.busy")) == (0, [])
    assert_account_holds(run)


def test_each_has_its_own_share() -> None:
    fault = '[[station.sim.fault]]\nkind = "silence"\nat_s = 5\nfor_s = 20\nevery = 20\n'
    run = prepare(line_text(fault), duration_s=60)
    stop_the_host(run, 40, 0.85)
    run.go()
    assert 6 <= (run.facts.skipped_by_host or 0) <= 9
    assert skipped(run) / 2 - (run.facts.skipped_by_host or 0) > 5


def test_each_is_told_with_its_own_delay() -> None:
    """A tick that the station delays by seconds does not count as a delay of the computer, which
    was suspended only briefly.
    """
    fault = '[[station.sim.fault]]\nkind = "silence"\nat_s = 5\nfor_s = 20\nevery = 2\n'
    run = prepare(line_text(fault), duration_s=60)
    for at_s in (10.0, 15.0, 20.0):
        stop_the_host(run, at_s, 0.25)
    run.go()
    busy, slow = run.memory.of_kind("host.busy"), run.memory.of_kind("station.slow")
    delays = {
        kind: max(float(str(one.raw).removeprefix("late_s=")) for one in events)
        for kind, events in (("host", busy), ("station", slow))
    }
    assert 0.2 < delays["host"] < 0.4
    assert delays["station"] > 2
    assert_account_holds(run)


def test_the_delay_of_skipped_ticks_is_the_part_that_was_given_and_the_greatest() -> None:
    """Not the time since the tick was due, which contains the delay of the other side."""
    late = SkippedTicks()
    late.add(3, 10.0, 0.2, 10.5)
    late.add(1, 20.0, 0.15, 20.3)
    assert late == SkippedTicks(ticks=4, places=2, late_s=0.2, since=10.0, last=20.3)
    assert (
        "4 sampling times were skipped in 2 places (one is due every 0.1 s), up to 0.20 s late."
        in late.text(0.1)
    )
    once = SkippedTicks(ticks=1, places=1, late_s=0.2)
    assert "1 sampling time was skipped (one is due every 0.5 s)" in once.text_of_station(0.5)


# -- the measure itself ----------------------------------------------------------------------------


async def steps() -> str:
    first = await do(Ask(b"?", 0.5))
    second = await do(Listen(first.now + 1))
    await do(Wait(second.now + 10))
    await do(Reopen())
    return "done"


def watched(*heard: tuple[float, bytes, float] | None) -> Standstill:
    """Return what is measured if requests end like that: time, bytes, delay of the driver. The
    first begins at 100 s.

    None: the link breaks there.
    """
    measure = Standstill()
    session = measure.watch(steps(), 100.0)
    pull(session)
    with suppress(StopIteration):
        for one in heard:
            if one is None:
                with pytest.raises(LinkError):
                    throw(session, LinkError("gone"))
                session = measure.watch(later(), 100.0)  # nobody has said when
                pull(session)
            else:
                send(session, IoResult(one[0], one[1], 100.0, one[2]))
    return measure


async def later() -> None:
    await do(Wait(0.0))


def spans(*moments: float) -> list[tuple[float, float]]:
    """Return when the host was suspended if the requests ended at these times."""
    return [
        (round(begin, 3), round(end, 3))
        for begin, end in watched(*((moment, b"", 0.0) for moment in moments)).spans
    ]


def test_what_a_wish_allows_is_no_standstill() -> None:
    assert spans(100.5, 101.5, 111.5, 140.0) == []  # opening a port may take its time


def test_what_is_beyond_it_is() -> None:
    assert spans(107.5, 108.5, 118.5, 118.5) == [(100.5, 107.5)]
    assert spans(100.5, 108.5, 118.5, 118.5) == [(101.5, 108.5)]
    assert spans(100.5, 101.5, 118.5, 118.5) == [(111.5, 118.5)]
    assert spans(107.5, 115.5, 132.5, 132.5) == [(100.5, 107.5), (108.5, 115.5), (125.5, 132.5)]


def test_a_busy_host_is_no_standstill() -> None:
    assert spans(105.4, 111.3, 126.2, 126.2) == []


def test_an_answer_that_waited_unheard_is_the_hosts_and_a_slow_one_the_stations() -> None:
    assert watched((100.45, b"a", 0.4)).late_s == pytest.approx(0.4)
    assert watched((100.45, b"a", 0.0)).late_s == 0.0
    assert watched((100.5, b"", 0.4)).late_s == 0.0  # there was none to be heard
    # asleep anyhow
    assert watched(
        (100.1, b"a", 0.0), (101.1, b"", 0.0), (111.1, b"", 0.9)
    ).late_s == pytest.approx(0.0)
    assert watched((106.0, b"a", 6.0)).spans == [(100.0, 106.0)]


def test_a_question_that_was_out_when_the_link_broke_may_have_taken_its_time() -> None:
    assert watched(None, (105.4, b"", 0.0)).spans == []
    assert watched(None, (106.0, b"", 0.0)).spans == [(100.5, 106.0)]


def test_how_long_a_port_took_that_could_not_be_opened_is_not_known() -> None:
    assert (
        watched(
            (100.1, b"a", 0.0), (101.1, b"", 0.0), (111.1, b"", 0.0), None, (180.0, b"", 0.0)
        ).spans
        == []
    )
