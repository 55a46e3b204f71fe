"""The idle tip: what is counted, and that joints, heating up and silence are not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from jbclog.analysis.port_data import SETTING_HOLDS_S, setting_in_force
from jbclog.analysis.verdict import judge
from jbclog.analysis.verdict.idle import Block, IdleError, by_block
from jbclog.analysis.verdict.reached import Heat
from jbclog.analysis.verdict.samples import measure
from jbclog.config.recipe_sections import Acceptance


def idle(case: Any) -> IdleError:
    evidence = case.evidence()
    return measure(evidence.folder, {facts.name: facts for facts in evidence.stations})["a", 1].idle


def test_mean_and_deviation_of_a_quiet_tip(case: Any, tip: Callable[..., Any]) -> None:
    one = tip(60)
    one.temperature = [350 + (3 if i % 2 else 5) for i in range(600)]
    case.station("a", one)
    found = idle(case)
    assert found.mean_c == pytest.approx(4)
    assert found.sd_c == pytest.approx(1, rel=0.01)
    assert found.rows == 580  # two seconds to see that it is calm


def test_joints_and_their_recovery_are_left_out(case: Any, tip: Callable[..., Any]) -> None:
    one = tip(120)
    for start in range(10, 120, 20):
        one.at(start, 1.5, 320, 700).at(start + 1.5, 1.5, 340, 300).at(start + 3, 0.8, 356, 0)
    case.station("a", one)
    found = idle(case)
    assert found.mean_c == pytest.approx(0, abs=0.01)
    assert found.sd_c == pytest.approx(0, abs=0.01)


def test_heating_up_is_left_out_and_a_constant_error_is_not(
    case: Any, tip: Callable[..., Any]
) -> None:
    one = tip(60)
    for i in range(60):
        one.temperature[i], one.power[i] = 30 + 5 * i, 1000
    for i in range(60, 600):
        one.temperature[i] = 328
    case.station("a", one)
    assert idle(case).mean_c == pytest.approx(-22)
    judgement = judge(case.evidence(), {"a": Acceptance(idle_error_c=15)})
    assert judgement.verdict == "REJECT"
    assert "-22.0 °C" in judgement.rules[-1].text


def test_an_oscillating_tip_is_seen(case: Any, tip: Callable[..., Any]) -> None:
    one = tip(60)
    one.temperature = [350] * 40 + [350 + (20 if i // 10 % 2 else -20) for i in range(560)]
    case.station("a", one)
    assert judge(case.evidence(), {"a": Acceptance(idle_sd_c=5)}).verdict == "REJECT"


@pytest.mark.parametrize("status", ["stand", "sleep", "hibernation", "off", None])
def test_a_tool_that_does_not_work_is_not_idle(
    case: Any, tip: Callable[..., Any], status: str | None
) -> None:
    one = tip()
    one.status = [status] * 600
    case.station("a", one)
    assert idle(case).rows == 0
    assert judge(case.evidence(), {"a": Acceptance(idle_error_c=15)}).verdict == "INCONCLUSIVE"


def test_too_little_is_unknown_and_never_zero(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip(4.5))
    assert idle(case).rows == 25
    assert idle(case).mean_c is None
    assert idle(case).sd_c is None


def test_a_setting_that_is_no_longer_known_is_not_compared_with(
    case: Any, tip: Callable[..., Any]
) -> None:
    one = tip(60)
    one.setting = [350] + [None] * 599
    case.station("a", one)
    # from 2 s, calm, to 15 s, the last moment at which the reading holds
    assert idle(case).rows == 131


def test_after_a_change_of_the_setting_the_tip_must_settle_again(
    case: Any, tip: Callable[..., Any]
) -> None:
    one = tip(60)
    for i in range(300, 600):
        one.setting[i] = 380 if one.setting[i] else None
        one.temperature[i] = min(380, 350 + (i - 300))
    case.station("a", one)
    found = idle(case)
    assert found.mean_c is not None
    assert abs(found.mean_c) < 0.5


def test_lost_rows_neither_settle_nor_count(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip(60).lose(20, 10))
    assert idle(case).rows == 600 - 20 - 100 - 20


def test_a_slow_recorder_measures_the_idle_error_too(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip(120, hz=0.5))
    assert idle(case).mean_c == pytest.approx(0)


# -- a tool that is pulled -------------------------------------------------------------------------


def pulled(one: Any, at: int, until: int, falls: float = 350.0) -> Any:
    """A tool is pulled at one tick and back at another: its readings fall, and its port says so
    when it is asked next.
    """
    for i in range(at, until):
        one.temperature[i], one.power[i] = max(0, round(350 - falls * (i - at + 1))), 0
        one.port_error[i] = None if one.port_error[i] is None else 4
        one.tool[i] = None if one.tool[i] is None else 0
    return one


@pytest.mark.parametrize("falls", [350.0, 2.0])
@pytest.mark.parametrize("until", [600, 400])
def test_a_tool_that_was_pulled_is_not_idle_before_anybody_knows(
    case: Any, tip: Callable[..., Any], falls: float, until: int
) -> None:
    case.station("a", pulled(tip(60), 301, until, falls))
    found = idle(case)
    assert found.mean_c == pytest.approx(0, abs=0.01)
    assert found.rows >= 270  # and what came before, two seconds of it at the most, is


def test_a_tool_that_is_pulled_at_the_very_end_is_not_idle(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", pulled(tip(59), 582, 590))
    assert idle(case).mean_c == pytest.approx(0, abs=0.01)


def test_between_two_tools_nothing_is_idle(case: Any, tip: Callable[..., Any]) -> None:
    one = tip(60)
    for i in range(303, 600):
        one.tool[i] = None if one.tool[i] is None else 3
    one.at(30.3, 0.5, 200, 0)
    case.station("a", one)
    assert idle(case).mean_c == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize(("code", "rows"), [(7, 280), (9, 580)])
def test_a_port_that_does_not_work_is_not_idle_and_one_that_warns_is(
    case: Any, tip: Callable[..., Any], code: int, rows: int
) -> None:
    one = tip(60)
    one.port_error = [
        code if i >= 301 and said is not None else said for i, said in enumerate(one.port_error)
    ]
    case.station("a", one)
    assert idle(case).rows == pytest.approx(rows, abs=20)


def test_a_tip_that_is_far_too_cold_in_its_port_still_counts(
    case: Any, tip: Callable[..., Any]
) -> None:
    one = tip(60)
    one.temperature = [200] * 600
    case.station("a", one)
    assert idle(case).mean_c == pytest.approx(-150)


@pytest.mark.parametrize("back_s", [0.0, 900.0])
def test_every_row_is_in_the_block_of_its_time(back_s: float) -> None:
    """Also where a clock was set back."""
    seconds = np.arange(0, 3000, 0.5)
    seconds[3500:] -= back_s
    blocks = by_block(seconds)
    numbers = [number for number, _ in blocks]
    assert numbers == [0, 1, 2, 3, 4][: 5 - (back_s > 0)]
    for number, rows in blocks:
        assert (np.floor(seconds[rows] / 600) == number).all()
    assert sum(len(seconds[rows]) for _, rows in blocks) == len(seconds)
    assert by_block(np.empty(0)) == []


@pytest.mark.parametrize("first", [0, 7])
def test_a_setpoint_is_in_force_until_the_next_one_is_read_or_for_its_time(first: int) -> None:
    """Also where the rows come in pieces (`Heat`)."""
    seconds, setting = np.arange(600) / 10, np.full(600, np.nan)
    setting[[first, first + 50, first + 51, first + 300]] = [350, 380, 330, 340]
    expected = np.full(600, np.nan)
    for row in range(600):
        read = np.flatnonzero(~np.isnan(setting[: row + 1]))
        if len(read) and seconds[row] - seconds[read[-1]] <= SETTING_HOLDS_S:
            expected[row] = setting[read[-1]]
    assert 100 < np.isnan(expected).sum() < 300
    assert np.array_equal(setting_in_force(seconds, setting), expected, equal_nan=True)
    heat, none = Heat(0.1), np.zeros(600, dtype=np.bool_)
    pieces = [slice(0, 1), slice(1, 5), slice(5, 55), slice(55, 56), slice(56, 600)]
    block = Block(seconds, seconds, seconds, setting, none)
    found = np.concatenate([heat._settings(block.take(rows)) for rows in pieces])
    assert np.array_equal(found, expected, equal_nan=True)
    assert np.isnan(setting_in_force(seconds, np.full(600, np.nan))).all()
    assert not len(setting_in_force(np.empty(0), np.empty(0)))
