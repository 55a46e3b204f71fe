"""A flooded link counts as lost: nothing received on it is believed, and its tools still get their
safe orders.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from support.links.flooding import FALSE_C, SHAPES, flood
from support.oracles.account import assert_account_holds, reasons_in
from support.product import (
    COLUMN,
    LONGEST_AFTER_FLOOD_S,
    NOT_AS_PLANNED,
    STAND,
    Divergence,
    Peer,
    ReplayStep,
    Session,
    StationFacts,
    StationTask,
    Steps,
    VirtualClock,
    VirtualDriver,
    captured_steps,
    do,
    pull,
    replayed_steps,
    send,
    throw,
)
from support.virtual.lines import line
from support.virtual.virtual_run import Memory, VirtualRun, prepare

FAST = 100_000.0  # bytes a second
every_shape = pytest.mark.parametrize("shape", SHAPES)


def rows_of(run: VirtualRun, name: str) -> list[list[object]]:
    return [row for row in run.memory.samples if row[COLUMN["station"]] == name]


def only(run: VirtualRun, name: str) -> VirtualRun:
    """Return the part of the run that belongs to one station."""
    memory = Memory(
        samples=[row for row in run.memory.samples if row[COLUMN["station"]] == name],
        counters=[row for row in run.memory.counters if row.station == name],
    )
    return replace(run, memory=memory, contexts={name: run.contexts[name]})


def of_links(run: VirtualRun) -> list[str]:
    return [
        event.kind
        for event in run.memory.events
        if event.kind.startswith(("link.", "robot.", "identity."))
    ]


def due_s(run: VirtualRun, row: list[object]) -> float:
    tick = row[COLUMN["tick"]]
    assert isinstance(tick, int)
    return tick * (run.contexts["dde-1"].facts.period_s or 0.0)


@every_shape
@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_a_flooded_link_is_lost_and_back_and_the_neighbour_does_not_notice(
    shape: str, rate: float
) -> None:
    alone = prepare(line("", ""), duration_s=20, rate=rate).go()
    run = prepare(line("", ""), duration_s=20, rate=rate)
    flood(run, "dde-1", shape, FAST, 6, 11)
    run.go()
    # one refusal before the flood shows ends the asking, too
    kinds = [kind for kind in of_links(run) if kind != "robot.off"]
    assert kinds in (["link.flooded", "link.back"], ["link.flooded", "robot.on"])
    assert {name: context.facts.outcome for name, context in run.contexts.items()} == {
        "dde-1": "completed",
        "dde-2": "completed",
    }
    assert {name: context.facts.outages for name, context in run.contexts.items()} == {
        "dde-1": 1,
        "dde-2": 0,
    }
    assert_account_holds(only(run, "dde-1"))
    assert rows_of(run, "dde-2") == rows_of(alone, "dde-2")
    for row in rows_of(run, "dde-1"):
        second = due_s(run, row)
        if 8.1 < second < 10.9:
            assert row[COLUMN["temperature_c"]] is None
            assert reasons_in(row)["temperature_c"] == (
                "disconnected" if "link.back" in kinds else "robot_off"
            )
        # the last try may have been a moment before the end of the flood
        elif second < 5.9 or second > 16:
            assert row[COLUMN["quality"]] == "ok"
        assert row[COLUMN["temperature_c"]] != FALSE_C
    (event,) = run.memory.of_kind("link.flooded")
    assert "answers of" in event.text
    assert event.value is not None
    assert event.limit_value is not None
    assert event.value > event.limit_value


def test_it_keeps_a_run_from_a_plain_accept() -> None:
    assert "link.flooded" in NOT_AS_PLANNED


@pytest.mark.parametrize(
    ("times", "kinds"), [(5, []), (8, []), (12, ["link.flooded", "link.back"])]
)
def test_ten_times_the_bytes_that_are_due_are_the_limit(times: float, kinds: list[str]) -> None:
    """At 5 Hz this line has about 45 answers a second, each of about 15 bytes."""
    sound = prepare(duration_s=20, rate=5.0).go()
    answered = [one for one in sound.heard if sound.t0 + 8 <= one.at < sound.t0 + 18]
    due_per_s = sum(len(one.clean or "") + 8 for one in answered) / 10
    run = prepare(duration_s=20, rate=5.0)
    flood(run, "dde-1", "STX alone", (times - 1) * due_per_s, 8, 13)
    run.go()
    assert [kind for kind in of_links(run) if kind != "link.lost"][:2] == kinds


def test_a_burst_of_noise_is_no_flood() -> None:
    run = prepare(duration_s=12, rate=5.0)
    run.at(6.0, lambda: run.driver.say("dde-1", b"\xaa" * 2000))
    run.go()
    assert of_links(run) == []
    assert run.facts.outages == 0


def test_a_flood_that_does_not_end_leaves_the_tools_told_and_not_verified() -> None:
    run = prepare(line("", ""), duration_s=15, rate=5.0)
    flood(run, "dde-1", "copies of the safe state", FAST, 6, 40)
    run.go()
    flooded, other = run.contexts["dde-1"].facts, run.contexts["dde-2"].facts
    assert flooded.outcome == "gone"
    assert flooded.safe_state == {1: "sent", 2: "sent"}
    assert other.safe_state == {1: "verified", 2: "verified"}
    assert all("its link is flooded" in text for text in flooded.unsafe)
    assert len(flooded.unsafe) == 2
    assert len(run.memory.of_kind("link.flooded")) == 1
    orders = [
        one.at - run.t0 for one in run.taps["dde-1"].heard if one.text in ("WPS100001", "WPS200001")
    ]
    assert len(orders) >= 2
    assert max(orders) < 15 + 10
    assert run.driver.clock.monotonic() - run.t0 < 15 + 10
    assert [write.value for write in run.station.log.written("status") if write.port == 1][
        -1
    ] == STAND


def test_a_flood_that_begins_while_the_tools_are_made_safe_is_in_the_record() -> None:
    run = prepare(line("", ""), duration_s=6, rate=1.0)
    flood(run, "dde-1", "noise", FAST, 6.0, 40)
    run.go()
    assert len(run.memory.of_kind("link.flooded")) == 1
    assert run.contexts["dde-1"].facts.safe_state == {1: "sent", 2: "sent"}
    assert run.contexts["dde-2"].facts.safe_state == {1: "verified", 2: "verified"}


def test_it_is_tried_ever_more_rarely_where_it_is_flooded_again_and_again() -> None:
    run = prepare(duration_s=200, rate=5.0)
    for second in range(10, 180, 2):  # so that it comes back in between
        flood(run, "dde-1", "noise", FAST, second, second + 1.2)
    run.go()
    assert len(run.memory.of_kind("link.flooded")) < 25
    assert_account_holds(run)
    back = [event for event in run.memory.events if event.kind == "link.back"]
    assert max(event.value or 0.0 for event in back) > LONGEST_AFTER_FLOOD_S / 2


def test_a_link_that_is_flooded_from_the_start_refuses_the_run_within_seconds() -> None:
    run = prepare(line("", ""), duration_s=10)
    flood(run, "dde-1", "another model's answers", FAST, 0.0, 30)
    run.go()
    assert run.contexts["dde-1"].facts.outcome == "gone"
    assert "the link is flooded" in run.contexts["dde-1"].facts.reason
    assert run.contexts["dde-2"].facts.outcome == "not_started"
    assert run.driver.clock.monotonic() - run.t0 < 10
    assert [one.text for one in run.taps["dde-1"].heard if one.is_write] == []


def test_a_run_with_a_flood_is_lived_through_again_to_the_row() -> None:
    tape: list[ReplayStep] = []

    def noted(
        order: StationTask, session: Steps[StationFacts], cable: Peer
    ) -> tuple[Steps[StationFacts], Peer]:
        return _noted(session, tape), cable

    run = prepare(duration_s=15, rate=5.0, pulled=noted)
    flood(run, "dde-1", "all answers in turn", FAST, 6, 8)
    run.go()
    assert of_links(run) == ["link.flooded", "link.back"]
    again = _relived(run, tape)
    assert again.samples == run.memory.samples
    assert again.events == run.memory.events


async def _noted(session: Steps[StationFacts], tape: list[ReplayStep]) -> StationFacts:
    """Return the session; write everything that it receives to the tape."""
    given: list[bytes] = [b""]
    asked: list[bytes] = [b""]

    def keep(told: object) -> None:
        tape.append(ReplayStep(told, asked[0], given[0]))  # type: ignore[arg-type]

    steps = captured_steps(session, keep, lambda: 0.0)
    try:
        request = pull(steps)
        while True:
            asked[0] = getattr(request, "data", b"")
            try:
                heard = await do(request)
            except Exception as error:
                given[0] = b""
                request = throw(steps, error)
            else:
                given[0] = heard.data
                request = send(steps, heard)
    except StopIteration as end:
        facts: StationFacts = end.value
        return facts


def _relived(run: VirtualRun, tape: list[ReplayStep]) -> Memory:
    clock = VirtualClock()
    memory, driver = Memory(), VirtualDriver(clock)
    context = Session(next(iter(run.contexts.values())).order, memory, clock)

    def astray(where: Divergence) -> None:
        raise AssertionError(str(where))

    driver.add(replayed_steps(context.steps(), tape, astray), run.taps["dde-1"])
    driver.run()
    return memory
