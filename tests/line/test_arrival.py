"""When alarms start to count: once the tool has reached its setpoint, and never after a single
answer.
"""

from __future__ import annotations

import pytest

from support.virtual.lines import first_sample_s, say
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

NEAR_LIMIT = RECIPE.replace("limit_c = 250", "limit_c = 320")


def cold(recipe: str = NEAR_LIMIT, stuck_c: int = 310, duration_s: float = 14) -> VirtualRun:
    """A working tool whose tip stays where it is, below its setpoint of 350 °C."""
    run = prepare(
        line_text("joints_per_minute = 0\n", "ports = [1]"), recipe, duration_s=duration_s
    )
    run.station.plant.ports[1].stuck_c = stuck_c
    return run


def has_arrived(run: VirtualRun) -> bool:
    return run.contexts["dde-1"].ports[1].at_temperature


def latch_low(run: VirtualRun, at_s: float) -> None:
    run.at(at_s, lambda: setattr(run.station.plant.ports[1].low, "latched", True))


def test_one_answer_near_the_setting_does_not_bring_the_tool_there() -> None:
    """From 00310 to 00345 is no jump. If that one answer counted, the flag raised while heating up
    would be an alarm.
    """
    run = cold()
    say(run, "TT1", "00345", 6)
    latch_low(run, 7)
    run.go()
    assert not has_arrived(run)
    assert run.memory.of_kind("alarm.low") == []
    assert len(run.memory.of_kind("alarm.low.not_working")) == 1
    assert 345 not in run.memory.column("temperature_c")


def test_two_answers_near_the_setting_do() -> None:
    run = cold()
    run.at(6, lambda: setattr(run.station.plant.ports[1], "stuck_c", 345))
    run.at(7, lambda: setattr(run.station.plant.ports[1], "stuck_c", 310))
    latch_low(run, 8)
    run.go()
    assert has_arrived(run)
    assert len(run.memory.of_kind("alarm.low")) == 1


def test_one_answer_beyond_the_setting_does_not_either() -> None:
    """A tip that heats up quickly can pass its setpoint between two readings, but then two answers
    show it.
    """
    run = cold(stuck_c=335)
    say(run, "TT1", "00365", 6)
    run.go()
    assert not has_arrived(run)


def test_a_tip_that_passed_its_setting_between_two_readings_was_there() -> None:
    run = cold(stuck_c=335)
    run.at(6, lambda: setattr(run.station.plant.ports[1], "stuck_c", 365))
    assert has_arrived(run.go())


def test_a_tip_found_too_hot_is_not_taken_to_run_away_by_one_answer() -> None:
    run = cold(RECIPE, stuck_c=400, duration_s=16)
    run.at(8, lambda: setattr(run.station.plant.ports[1], "stuck_c", 380))  # it cools
    say(run, "TT1", "00402", first_sample_s() + 10)  # when it is looked at whether it has
    run.go()
    assert not has_arrived(run)


def test_one_that_does_run_away_is() -> None:
    run = cold(RECIPE, stuck_c=400, duration_s=16).go()
    assert has_arrived(run)


@pytest.mark.parametrize(
    ("side", "answer", "limits"), [("high", "00370", (365, 250)), ("low", "00340", (380, 345))]
)
def test_one_answer_beyond_a_limit_bears_no_alarm_out(
    side: str, answer: str, limits: tuple[int, int]
) -> None:
    """00350 and 00370 differ in one bit, and their check bytes in another."""
    high, low = limits
    recipe = RECIPE.replace("limit_c = 380", f"limit_c = {high}").replace(
        "limit_c = 250", f"limit_c = {low}"
    )
    for moment in (12.0, 12.5, 13.0, 13.5, 14.0, 14.5):
        run = cold(recipe, stuck_c=350, duration_s=20)
        run.at(
            12.1,
            lambda run=run: setattr(getattr(run.station.plant.ports[1], side), "latched", True),
        )
        say(run, "TT1", answer, moment)
        run.go()
        assert has_arrived(run)
        assert run.facts.alarms == 0
        assert run.facts.unconfirmed_alarms > 0
        assert int(answer) not in run.memory.column("temperature_c")
