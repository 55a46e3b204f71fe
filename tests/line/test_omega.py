"""Whole runs of an OMEGA on a virtual clock: its states at its own rate, its condition, and
requests that it refuses by silence.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right

import pytest

from support.oracles.account import assert_account_holds, reasons_in
from support.product import (
    COLUMN,
    SIGNAL_COLUMNS,
    ConditionRecord,
    Reply,
    SetTemperature,
    Severity,
    StationFacts,
)
from support.virtual.lines import fault
from support.virtual.virtual_run import Memory, VirtualRun, prepare

LINE = (
    '[line]\nname = "test"\n[[station]]\nname = "omega-1"\nurl = "omega-1"\nfamily ='
    ' "omega"\n{keys}\n[station.sim]\n{sim}\n'
)
HEAD = '[recipe]\nname = "test"\nrevision = 1\nfamilies = ["omega"]\n'
STATES = ("solder_shortage", "clogged", "preparing", "in_range")
WANTED = ConditionRecord(
    101, 0, 0.5, 2.0, 10.0, 0.5, 10.0, 0.8, 3.0, 8.0, 0.5, 10.0, 1.0, 0.0, 0.0, 1.0, 20.0
)


def asks_for(value: ConditionRecord) -> str:
    fields = "".join(f"{name} = {text}\n" for name, _, text in value.values())
    return f"{HEAD}[omega]\ncondition = {value.condition}\n{fields}"


def prepared(sim: str = "", recipe: str = HEAD, keys: str = "", **more: object) -> VirtualRun:
    return prepare(LINE.format(sim=sim, keys=keys), recipe, **more)  # type: ignore[arg-type]  # options of `prepare`


def also_says(run: VirtualRun, after_s: float, data: bytes) -> None:
    """Let the controller send something unasked, that long after the start."""
    receive, left = run.omega.receive, [Reply(run.t0 + after_s, data)]

    def both(sent: bytes, now: float) -> list[Reply]:
        return [*receive(sent, now), *([left.pop()] if left else [])]

    run.omega.receive = both  # type: ignore[method-assign]


def pulled_out_with(run: VirtualRun, letter: str) -> None:
    """Pull the cable permanently after a question with this letter."""
    receive = run.omega.receive

    def last(sent: bytes, now: float) -> list[Reply]:
        replies = receive(sent, now)
        if sent[1:2].decode() == letter:
            run.omega.is_unplugged = lambda _now: True  # type: ignore[method-assign]
        return replies

    run.omega.receive = last  # type: ignore[method-assign]


def outcomes(memory: Memory) -> dict[str, str]:
    """Return the outcome of each field of the condition."""
    return {row.setting.partition(".")[2]: row.outcome for row in memory.settings}


LETTERS = {"solder_shortage": "A", "clogged": "A", "preparing": "B", "in_range": "F"}
# digits that say so
YES = {"solder_shortage": "13", "clogged": "23", "preparing": "1", "in_range": "0"}


def wrong_states(run: VirtualRun) -> list[str]:
    """Return each state that differs from the controller's answer to a question of its row."""
    found, moments = [], [one.at for one in run.heard]
    for row in run.memory.samples:
        late, scan = row[COLUMN["late_us"]], row[COLUMN["scan_us"]]
        if not isinstance(late, int) or not isinstance(scan, int):
            continue
        begin = run.t0 + int(str(row[COLUMN["tick"]])) * 1.0 + late / 1e6
        asked = run.heard[
            bisect_left(moments, begin - 1e-4) : bisect_right(moments, begin + scan / 1e6)
        ]
        for name, letter in LETTERS.items():
            said = [one.clean[1] for one in asked if one.text == letter and one.clean is not None]
            if row[COLUMN[name]] is not None and row[COLUMN[name]] not in [
                digit in YES[name] for digit in said
            ]:
                found.append(
                    f"tick {row[COLUMN['tick']]}: {name} = {row[COLUMN[name]]}, the controller said"
                    f" {said}"
                )
    return found


# -- states ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("sim", ["", "turnaround_ms = 0", "turnaround_ms = 250", "wire = false"])
def test_its_states_are_sampled_once_a_second(sim: str) -> None:
    run = prepared(sim, duration_s=30).go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert run.facts.period_s == 1.0
    assert len(run.memory.samples) == 30
    assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}
    for name in STATES:
        assert all(isinstance(value, bool) for value in run.memory.column(name))
    others = [name for name in SIGNAL_COLUMNS if name not in STATES]
    assert {row[COLUMN[name]] for row in run.memory.samples for name in others} == {None}
    assert run.facts.due == {"1": {"solder_shortage": 30, "preparing": 30, "in_range": 30}}
    assert_account_holds(run)


def test_what_it_is_stands_in_the_facts_and_what_it_is_not_does_not() -> None:
    run = prepared(duration_s=3).go()
    facts = run.facts
    assert (facts.family, facts.model, facts.address, facts.baudrate, facts.ports) == (
        "omega",
        None,
        None,
        9600,
        [1],
    )
    assert (facts.tool_names, facts.touched, facts.safe_state, facts.not_supported) == (
        {},
        [],
        {},
        [],
    )
    assert facts.signals == ["solder_shortage", "preparing", "in_range"]


def test_it_says_that_it_has_no_safe_state() -> None:
    run = prepared(duration_s=3).go()
    (event,) = run.memory.of_kind("safety.not_available")
    assert event.severity is Severity.WARNING
    assert run.facts.unsafe == []


def test_a_run_asks_and_orders_nothing() -> None:
    run = prepared(duration_s=10).go()
    assert {one.text for one in run.heard} == {"A", "B", "F"}
    assert run.omega.log.writes == []


def test_three_questions_a_tick_of_up_to_a_quarter_of_a_second_each() -> None:
    """Manual 003, 11.1. At 3 Hz it cannot answer them all, and the refusal states the possible
    rate.
    """
    run = prepared("turnaround_ms = 250", duration_s=10, rate=3).go()
    assert run.facts.outcome == "refused"
    assert "The best rate is 1.2 Hz" in run.facts.reason
    assert prepared("turnaround_ms = 250", duration_s=10, rate="fit").go().facts.period_s == 1.0
    assert prepared("turnaround_ms = 5", duration_s=10, rate=10).go().facts.outcome == "completed"


def test_solder_that_runs_out_and_a_clog_are_errors_until_they_are_over() -> None:
    sim = (
        "turnaround_ms = 50"
        + fault("solder_shortage", at_s=5, for_s=5)
        + fault("clog", at_s=8, for_s=6)
    )
    run = prepared(sim, duration_s=20).go()
    kinds = [
        (event.kind, event.severity)
        for event in run.memory.events
        if event.kind.startswith(("solder", "feeder"))
    ]
    assert kinds == [
        ("solder.shortage", Severity.ERROR),
        ("feeder.clogged", Severity.ERROR),
        ("solder.shortage.ended", Severity.INFO),
        ("feeder.clogged.ended", Severity.INFO),
    ]
    shortage, clogged = run.memory.column("solder_shortage"), run.memory.column("clogged")
    assert (shortage.count(True), clogged.count(True)) == (5, 6)
    for event in run.memory.of_kind("solder.shortage"):
        assert event.earliest is not None
        assert 0 < event.time - event.earliest < 1.3e6


def test_what_is_wrong_at_the_first_reading_is_told() -> None:
    run = prepared(fault("solder_shortage") + fault("not_ready"), duration_s=3).go()
    assert [event.kind for event in run.memory.events if event.port == 1] == [
        "solder.shortage",
        "control.preparing",
    ]


def test_a_joint_takes_the_temperature_out_of_its_range_and_a_lasting_one_is_told() -> None:
    run = prepared(
        "turnaround_ms = 20\njoints_per_minute = 20\njoint_seconds = 1.8", duration_s=60
    ).go()
    assert run.memory.column("in_range").count(False) > 5
    assert run.memory.of_kind("temperature.out_of_range") == []
    run = prepared(
        "turnaround_ms = 20" + fault("out_of_range", at_s=10, for_s=15), duration_s=40
    ).go()
    (out,), (back,) = (
        run.memory.of_kind("temperature.out_of_range"),
        run.memory.of_kind("temperature.in_range"),
    )
    assert out.earliest is not None
    assert out.time - out.earliest >= 10e6
    assert back.time > out.time


def test_an_error_is_believed_when_it_is_said_twice() -> None:
    """Two flipped bits turn a0 into a valid a2: 0 and 2 differ in one bit, and so do the sums 91
    and 93.
    """
    run = prepared("turnaround_ms = 20", duration_s=20)
    told, left = run.omega.plant.information, [True]

    def information() -> str:
        lies = run.driver.clock.monotonic() > run.t0 + 8 and bool(left)
        return "solder clogged" if lies and left.pop() else told()

    run.omega.plant.information = information  # type: ignore[method-assign]
    run.go()
    assert left == []
    assert run.memory.of_kind("feeder.clogged") == []
    assert set(run.memory.column("clogged")) == {False}


# -- what does not come ----------------------------------------------------------------------------


def test_a_lost_answer_is_asked_for_again() -> None:
    run = prepared("turnaround_ms = 20" + fault("silence", at_s=5, every=7), duration_s=40).go()
    assert run.facts.outcome == "completed"
    assert {row[COLUMN["quality"]] for row in run.memory.samples} <= {"ok", "skipped"}
    assert_account_holds(run)


@pytest.mark.parametrize("seed", range(6))
def test_noise_flipped_bits_and_late_answers_leave_no_wrong_value(seed: int) -> None:
    sim = f"seed = {seed}\njoints_per_minute = 30\njoint_seconds = 1.0"
    sim += (
        fault("noise", every=8, at_s=3)
        + fault("flip", every=13, at_s=3)
        + fault("late", every=17, at_s=3, by_s=0.6)
    )
    sim += (
        fault("solder_shortage", at_s=30, for_s=20)
        + fault("not_ready", at_s=40, for_s=20)
        + fault("silence", every=19, at_s=3)
    )
    run = prepared(sim, duration_s=120).go()
    assert run.facts.outcome == "completed"
    assert wrong_states(run) == []
    assert sum(row[COLUMN["quality"]] == "ok" for row in run.memory.samples) > 70
    assert_account_holds(run)


def test_a_state_that_it_never_answers_is_one_that_it_does_not_have() -> None:
    """It ignores what it does not know, and answers the next question."""
    run = prepared(
        "turnaround_ms = 20" + fault("nak", command="set_temperature_state"), duration_s=10
    ).go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert run.facts.not_supported == ["in_range"]
    assert set(run.memory.column("in_range")) == {None}
    assert [reasons_in(row) for row in run.memory.samples if reasons_in(row)] == []
    assert_account_holds(run)


def test_a_state_that_it_ignores_later_is_a_null_with_its_reason() -> None:
    run = prepared(
        "turnaround_ms = 20" + fault("nak", command="set_temperature_state", at_s=5, for_s=5),
        duration_s=20,
    ).go()
    missing = [row for row in run.memory.samples if reasons_in(row)]
    assert missing
    assert {reason for row in missing for reason in reasons_in(row).values()} <= {
        "timeout",
        "skipped",
    }
    assert run.memory.column("in_range")[-1] is not None
    assert_account_holds(run)


def test_an_outage_leaves_its_rows_and_says_that_the_station_may_be_another() -> None:
    run = prepared("turnaround_ms = 20" + fault("dropout", at_s=5, for_s=6), duration_s=30).go()
    assert run.facts.outages == 1
    qualities = [row[COLUMN["quality"]] for row in run.memory.samples]
    assert 5 <= qualities.count("disconnected") <= 8
    (back,) = run.memory.of_kind("link.back")
    assert "whether it is the same one cannot be told" in back.text
    assert_account_holds(run)


@pytest.mark.parametrize(
    ("for_s", "outcome", "reason"),
    [
        (
            3.0,
            "completed",
            "ended by SIGTERM while it did not answer; it answered again after that",
        ),
        (1000.0, "gone", "omega-1: not reachable when the run ended"),
    ],
    ids=["late", "gone"],
)
def test_one_that_was_only_late_when_the_run_was_ended_is_not_gone(
    for_s: float, outcome: str, reason: str
) -> None:
    """It has no safe state to confirm; an answer within the time that a run gives at its own end
    shows that it is there. Until then it counts as gone, so that `jbclog safe` does not wait.
    """
    sim = "turnaround_ms = 20" + fault("dropout", at_s=5, for_s=for_s)
    run, published = prepared(sim, duration_s=None), list[str]()
    keep = run.memory.facts

    def noted(facts: StationFacts) -> None:
        published.append(facts.outcome)
        keep(facts)

    run.memory.facts = noted  # type: ignore[method-assign]
    run.at(6.5, lambda: run.driver.end("ended by SIGTERM"))
    run.go()
    assert (run.facts.outcome, run.facts.reason) == (outcome, reason)
    assert ("gone" in published, published[-1]) == (True, outcome)
    assert len(run.memory.of_kind("station.gone")) == (outcome == "gone")
    assert run.memory.of_kind("link.lost")
    assert_account_holds(run)


def test_nobody_there() -> None:
    run = prepared(fault("silence"), duration_s=10).go()
    assert run.facts.outcome == "gone"
    assert "check that the station is on, the cable, and the line format" in run.facts.reason
    assert "Robot mode" not in run.facts.reason
    assert len(run.heard) <= 15  # five tries, the probes among them


def test_a_restart_is_lived_through() -> None:
    run = prepared("turnaround_ms = 20" + fault("restart", at_s=5, for_s=4), duration_s=30).go()
    assert run.facts.outcome == "completed"
    assert run.memory.of_kind("link.lost")
    assert run.memory.column("preparing")[-1] is False


def test_what_it_says_by_itself_is_an_event_and_answers_nothing() -> None:
    """A joint was ordered before the run began, so h arrives in the middle of it."""
    run = prepared("turnaround_ms = 20", duration_s=10)
    also_says(run, 5.3, b"\x02h\x0368")
    run.go()
    (event,) = run.memory.of_kind("omega.completed")
    assert event.raw == "h"
    assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}


# -- the condition ---------------------------------------------------------------------------------


def test_a_condition_that_holds_is_not_written() -> None:
    on_wire = "00650" + "005014064005064008" + "01E05000506400A" + "0000000" + "00A0C8"[1:]
    run = prepared(
        f'settings = {{ condition_101 = "{on_wire}" }}', asks_for(WANTED), duration_s=3
    ).go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert set(outcomes(run.memory).values()) == {"unchanged"}
    assert list(outcomes(run.memory)) == [name for name, _, _ in WANTED.values()]
    assert run.omega.log.writes == []
    assert run.memory.of_kind("setting.changed") == []  # it is read once more at the end
    assert run.facts.settings_changed == 0


def test_another_condition_is_not_written_without_leave() -> None:
    run = prepared(recipe=asks_for(WANTED), duration_s=3).go()
    assert run.facts.outcome == "refused"
    assert (
        "rise_s 0.3 instead of 0.5. Nothing was written; run with --allow-omega-write"
        in run.facts.reason
    )
    assert outcomes(run.memory)["rise_s"] == "mismatch"
    assert set(outcomes(run.memory).values()) == {"mismatch", "unchanged"}
    assert {row.written for row in run.memory.settings} == {None}
    assert run.omega.log.writes == []


def test_with_leave_it_is_written_once_and_read_back() -> None:
    run = prepared(recipe=asks_for(WANTED), duration_s=3, allow_omega_write=True).go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert set(outcomes(run.memory).values()) == {"confirmed"}
    assert [one.value for one in run.omega.log.writes] == [WANTED]
    rows = {row.setting: row for row in run.memory.settings}
    assert rows["condition_101.rise_s"][5:9] == ("s", "0.5", "0.5", "0.5")
    assert rows["condition_101.mode"].port is None


def test_what_the_controller_does_not_take_is_refused() -> None:
    """The virtual one accepts no speed above 60 mm/s: it does not answer the write, but answers the
    next question.
    """
    fast = ConditionRecord(
        **{**{name: getattr(WANTED, name) for name in WANTED.__slots__}, "feed1_mm_s": 99.0}
    )
    run = prepared(recipe=asks_for(fast), duration_s=3, allow_omega_write=True).go()
    assert run.facts.outcome == "refused"
    assert (
        "the controller ignored it, and read back it has rise_s 0.3 instead of 0.5"
        in run.facts.reason
    )
    assert outcomes(run.memory)["feed1_mm_s"] == "refused"
    assert [one.text[0] for one in run.heard].count("D") == 1


def test_a_lost_acknowledgement_is_settled_by_reading_back() -> None:
    run = prepared(
        fault("silence", command="store_condition"),
        asks_for(WANTED),
        duration_s=3,
        allow_omega_write=True,
    ).go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert set(outcomes(run.memory).values()) == {"confirmed"}
    assert [one.text[0] for one in run.heard].count("D") == 1


def test_a_write_that_cannot_be_read_back_is_not_confirmed() -> None:
    """The cable is pulled during the write. Nothing shows whether it was done, and it is not sent
    again.
    """
    run = prepared("turnaround_ms = 20", asks_for(WANTED), duration_s=5, allow_omega_write=True)
    pulled_out_with(run, "D")
    run.go()
    assert run.facts.outcome == "gone"
    assert set(outcomes(run.memory).values()) == {"unconfirmed"}
    assert [one.text[0] for one in run.heard].count("D") == 1


def test_a_condition_that_it_does_not_know() -> None:
    run = prepared(
        fault("nak", command="condition"), asks_for(WANTED), duration_s=3, allow_omega_write=True
    ).go()
    assert run.facts.outcome == "refused"
    assert "it does not know condition 101" in run.facts.reason
    assert set(outcomes(run.memory).values()) == {"refused"}
    assert run.omega.log.writes == []


def test_a_condition_that_somebody_changes_is_found_at_the_end() -> None:
    run = prepared(recipe=asks_for(WANTED), duration_s=10, allow_omega_write=True)
    other = ConditionRecord(
        **{**{name: getattr(WANTED, name) for name in WANTED.__slots__}, "preheat_s": 2.5}
    )
    run.at(8, lambda: run.omega.plant.store(other))
    run.go()
    (event,) = run.memory.of_kind("setting.changed")
    assert (
        event.text
        == "The condition 101 was found changed: preheat_s 2.5 instead of preheat_s 0.8. It was not"
        " written again."
    )
    assert run.facts.settings_changed == 1


def test_a_condition_that_cannot_be_read_at_the_end_is_said() -> None:
    sim = "turnaround_ms = 20" + fault("nak", command="condition", at_s=6)
    run = prepared(sim, asks_for(WANTED), duration_s=10, allow_omega_write=True).go()
    assert run.facts.outcome == "completed"
    (event,) = run.memory.of_kind("setting.unread")
    assert event.text.startswith(
        "Condition 101 could not be read at the end: condition 101: ignored"
    )


def test_a_condition_that_came_back_different_from_an_outage_stops_the_run() -> None:
    sim = "turnaround_ms = 20" + fault("dropout", at_s=5, for_s=5)
    run = prepared(sim, asks_for(WANTED), duration_s=30, allow_omega_write=True)
    run.at(7, lambda: run.omega.plant.store(WANTED_OTHERWISE))
    run.go()
    assert run.facts.outcome == "stopped"
    assert run.memory.of_kind("setting.changed")


WANTED_OTHERWISE = ConditionRecord(
    101, 1, 0.5, 2.0, 10.0, 0.5, 10.0, 0.8, 3.0, 8.0, 0.5, 10.0, 1.0, 0.0, 0.0, 1.0, 20.0
)


@pytest.mark.parametrize(("sim", "raw"), [("", 3500), ('quirks = ["temperature_in_degrees"]', 350)])
def test_a_set_temperature_is_kept_raw_and_marked(sim: str, raw: int) -> None:
    """docs/reference/contradictions.md, B-51: nothing here shows whether it is in tenths."""
    wanted = ConditionRecord(399, *[getattr(WANTED, name) for name in WANTED.__slots__[1:]])
    run = prepared(sim, asks_for(wanted), duration_s=3).go()
    assert run.facts.outcome == "refused"
    (event,) = run.memory.of_kind("protocol.anomaly")
    assert (event.code, event.raw) == (51, f"018F5{raw:03X}000")
    assert f"{raw / 10:.1f} °C if it is in tenths and {raw} °C if it is not" in event.text
    assert run.omega.plant.condition(399) == SetTemperature(399, raw, 0)
