"""Every transition of the alarm machine, as a table that was written by hand, and its clocks."""

from __future__ import annotations

import pytest

from jbclog.analysis.alarms.state_machine import (
    Condition,
    Definition,
    Detector,
    Machine,
    Phase,
    Rules,
    Side,
    State,
    Transition,
    definition_of,
    number_of,
)

ON_S, OFF_S = 1.0, 2.0
AT_380 = Definition(Side.HIGH, 380, on_delay_s=ON_S, off_delay_s=OFF_S, dead_band_c=2)

# phase, condition, whether the delay that runs is over with this reading: next phase, what is told
TRUTH = [
    ("normal", "gap", False, "normal", None),
    ("normal", "not counted", False, "normal", None),
    ("normal", "beyond", False, "pending", None),
    ("normal", "in band", False, "normal", None),
    ("normal", "back", False, "normal", None),
    ("pending", "gap", False, "pending", None),
    ("pending", "gap", True, "pending", None),
    ("pending", "not counted", True, "normal", None),
    ("pending", "beyond", False, "pending", None),
    ("pending", "beyond", True, "active", "raised"),
    ("pending", "in band", True, "normal", None),
    ("pending", "back", True, "normal", None),
    ("active", "gap", True, "active", None),
    ("active", "not counted", False, "normal", "cleared"),
    ("active", "beyond", True, "active", None),
    ("active", "in band", True, "active", None),
    ("active", "back", False, "clearing", None),
    ("clearing", "gap", False, "clearing", None),
    ("clearing", "gap", True, "clearing", None),
    ("clearing", "not counted", False, "normal", "cleared"),
    ("clearing", "beyond", True, "active", None),
    ("clearing", "in band", True, "active", None),
    ("clearing", "back", False, "clearing", None),
    ("clearing", "back", True, "normal", "cleared"),
]


def machine_in(phase: str) -> Machine:
    machine = Machine("dde-1", 1, Side.HIGH, Detector.SAMPLES)
    machine.definition = AT_380
    for condition, elapsed_s in (
        (Condition.BEYOND, 0.1),
        (Condition.BEYOND, ON_S),
        (Condition.BACK, 0.1),
    ):
        if machine.phase.value != phase:
            machine.step(condition, elapsed_s, 0, 1, 381)
    assert machine.phase.value == phase
    return machine


@pytest.mark.parametrize(("phase", "condition", "is_over", "then", "told"), TRUTH)
def test_every_transition(
    phase: str, condition: str, is_over: bool, then: str, told: str | None
) -> None:
    machine = machine_in(phase)
    news = machine.step(Condition(condition), 10.0 if is_over else 0.01, 2, 3, 381)
    assert machine.phase.value == then
    assert (news and news[0].value) == told


def test_the_table_is_whole() -> None:
    assert {(phase, condition) for phase, condition, *_ in TRUTH} == {
        (p.value, c.value) for p in Phase for c in Condition
    }


def step(
    machine: Machine,
    condition: Condition,
    elapsed_s: float,
    before: int,
    now: int,
    value: float = 381,
) -> Transition | None:
    news = machine.step(condition, elapsed_s, before, now, value)
    return news[0] if news else None


def test_a_gap_stops_the_clock_of_a_delay() -> None:
    machine = machine_in("pending")
    assert step(machine, Condition.BEYOND, 0.9, 1, 2) is None
    for _ in range(100):
        assert step(machine, Condition.GAP, 5.0, 2, 3) is None
    assert step(machine, Condition.BEYOND, 0.0, 2, 4) is None
    assert step(machine, Condition.BEYOND, 0.2, 4, 5) is Transition.RAISED


def test_without_delays_the_first_reading_raises_and_the_first_back_clears() -> None:
    machine = Machine("dde-1", 1, Side.LOW, Detector.AFTERWARDS)
    machine.definition = Definition(Side.LOW, 250)
    news = machine.step(machine.definition.condition(249), 0.0, 10, 20, 249)
    assert news is not None
    episode = news[1]
    assert (episode.onset_earliest_us, episode.onset_us, episode.raised_us, episode.state) == (
        10,
        20,
        20,
        State.ACTIVE,
    )
    assert machine.step(machine.definition.condition(240), 0.1, 20, 30, 240) is None
    assert machine.step(machine.definition.condition(250), 0.1, 30, 40, 250) == (
        Transition.CLEARED,
        episode,
    )
    assert (episode.end_earliest_us, episode.end_us, episode.peak_c, episode.state) == (
        30,
        40,
        240,
        State.CLEARED,
    )


def test_onset_and_end_are_where_the_limit_was_passed_not_where_the_delays_were_over() -> None:
    machine = Machine("dde-1", 1, Side.HIGH, Detector.SAMPLES)
    machine.definition = AT_380
    told = []
    for second in range(1, 12):
        value = 385 if 2 <= second <= 6 else 370
        told += [machine.step(AT_380.condition(value), 1.0, (second - 1) * 10, second * 10, value)]
    (raised, episode), (cleared, same) = [one for one in told if one]
    assert (raised, cleared, same) == (Transition.RAISED, Transition.CLEARED, episode)
    assert (episode.onset_earliest_us, episode.onset_us, episode.raised_us) == (10, 20, 30)
    assert (episode.end_earliest_us, episode.end_us, episode.cleared_us) == (60, 70, 90)


def test_what_came_back_before_the_tool_was_put_down_had_returned() -> None:
    machine = machine_in("clearing")
    news = machine.step(Condition.NOT_COUNTED, 0.1, 8, 9, 300, "not working")
    assert news is not None
    assert (news[1].end_earliest_us, news[1].end_us, news[1].end_reason) == (0, 1, "returned")


@pytest.mark.parametrize(
    ("side", "value", "condition"),
    [
        *(
            (Side.HIGH, value, condition)
            for value, condition in (
                (381, "beyond"),
                (380, "in band"),
                (379, "in band"),
                (378, "back"),
            )
        ),
        *(
            (Side.LOW, value, condition)
            for value, condition in (
                (379, "beyond"),
                (380, "in band"),
                (381, "in band"),
                (382, "back"),
            )
        ),
    ],
)
def test_limit_and_dead_band(side: Side, value: int, condition: str) -> None:
    assert Definition(side, 380, dead_band_c=2).condition(value).value == condition


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *(("380", 380), ("385 °C", 385), ("0.50 s", 0.5), ("off", None), (None, None)),
        *(("99999", 99999), ("inf", None), ("-1e400 °C", None), ("nan", None)),
    ],
)
def test_settings_as_the_record_has_them(text: str | None, value: float | None) -> None:
    assert number_of(text) == value


def test_what_is_off_or_unknown_is_not_evaluated() -> None:
    held: dict[str, float | None] = {
        "alarm_high_limit": 380,
        "alarm_high_delay": 1.6,
        "alarm_low_limit": 250,
        "alarm_low_delay": None,
    }
    assert definition_of(Side.HIGH, held, Rules()) == Definition(Side.HIGH, 380, 1.6, 1.6, 2.0)
    assert definition_of(Side.HIGH, held, Rules(1.0, 5.0)) == Definition(
        Side.HIGH, 380, 1.6, 5.0, 1.0
    )
    assert definition_of(Side.LOW, held, Rules()) is None
    assert definition_of(Side.HIGH, {"alarm_high_limit": 380}, Rules()) is None
    assert Definition(Side.HIGH, 380, 1.6, 1.6, 2.0).without_delays() == Definition(Side.HIGH, 380)
