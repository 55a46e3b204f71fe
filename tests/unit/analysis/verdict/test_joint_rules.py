"""The rules about joints: recovery by its bound, joints found against feeds counted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from jbclog.analysis.verdict import Feeds, Judgement, PortJoints, Recovery, Rule, judge
from jbclog.config.recipe_sections import Acceptance

RECOVERY = Acceptance(recovery_p95_s=2.5)
COUNTER = Acceptance(joints_against_counter_percent=2.0)
QUICK = [1.5] * 117
NAMES = ("recovery_p95", "recovered_before_next", "joints_against_counter")
RECOVERED = Acceptance(recovered_before_next_percent=95.0)
LATE, CUT_OFF = Recovery(1.8, back=False), Recovery(1.8, back=None)  # s that the tip had


def mixed(recoveries: Sequence[float | Recovery | None]) -> list[Recovery | None]:
    """The same as chance orders them: slow ones that follow each other are worth fewer. A number:
    back after so long.
    """
    told = [Recovery(one, True) if isinstance(one, float) else one for one in recoveries]
    return [told[place] for place in np.random.default_rng(1).permutation(len(told))]


def judged(
    case: Any,
    tip: Callable[..., Any],
    limits: Acceptance,
    seen: PortJoints | None,
    family: str = "ale",
) -> Judgement:
    case.station("a", tip()).family = family
    joints = {} if seen is None else {("a", 1): seen}
    return judge(replace(case.evidence(), joints=joints), {"a": limits})


def the_rule(judgement: Judgement) -> Rule:
    (found,) = [rule for rule in judgement.rules if rule.name in NAMES]
    assert found.text.endswith(".")
    return found


@pytest.mark.parametrize(
    ("recoveries", "result", "verdict"),
    [
        ([*QUICK, 2.5, 2.5, 2.5], "pass", "ACCEPT"),
        ([*QUICK, 2.6, 9.0, None], "missing", "INCONCLUSIVE"),  # of 120 one may lie above the bound
        ([*QUICK, None], "pass", "ACCEPT"),
        ([*QUICK, None, None, None], "missing", "INCONCLUSIVE"),
        # the figure keeps the limit, its bound does not
        ([*QUICK, *[2.6] * 5], "missing", "INCONCLUSIVE"),
        ([*QUICK, *[2.6] * 8], "fail", "REJECT"),
        ([2.6] * 3, "fail", "REJECT"),  # as many as there are broke it
        ([1.5] * 58, "missing", "INCONCLUSIVE"),
        ([None] * 70, "missing", "INCONCLUSIVE"),
        ([], "missing", "INCONCLUSIVE"),
    ],
)
def test_recovery_is_judged_by_its_figure_and_kept_by_its_bound(
    case: Any,
    tip: Callable[..., Any],
    recoveries: Sequence[float | Recovery | None],
    result: str,
    verdict: str,
) -> None:
    judgement = judged(case, tip, RECOVERY, PortJoints(mixed(recoveries)))
    rule = the_rule(judgement)
    assert (rule.result, judgement.verdict, rule.limit_value, rule.uom) == (
        result,
        verdict,
        2.5,
        "s",
    )
    assert (rule.observed is None) == (not [value for value in recoveries if value is not None])
    assert rule.bound is not None or result != "pass"


def test_the_figure_the_bound_and_n_stand_in_the_rule(case: Any, tip: Callable[..., Any]) -> None:
    rule = the_rule(judged(case, tip, RECOVERY, PortJoints(mixed([*QUICK, *[2.6] * 5]))))
    assert rule.observed == 1.5
    assert rule.bound is not None
    assert (rule.bound.high, rule.bound.n) == (2.6, 122)
    start = "95 % of 122 joints recovered within 1.50 s, allowed 2.5 s. "
    assert rule.text == start + "The 95 % bound is 2.60 s: more joints are needed."


@pytest.mark.parametrize(
    ("limits", "result", "observed"),
    [
        (Acceptance(recovery_p95_s=3.0), "missing", None),
        (Acceptance(recovery_p95_s=1.5), "fail", None),  # longer than what is allowed, all of them
        (RECOVERED, "fail", 0),
    ],
)
def test_a_line_whose_tip_never_recovers_is_no_pass(
    case: Any, tip: Callable[..., Any], limits: Acceptance, result: str, observed: float | None
) -> None:
    """488 joints, each followed by the next after 1.8 s with a tip that is still far below: no
    recovery is known to be short.
    """
    rule = the_rule(judged(case, tip, limits, PortJoints([LATE] * 488)))
    assert (rule.result, rule.observed) == (result, observed)
    if limits != RECOVERED:
        assert "After 488 of 488 joints the next one began before the tip recovered." in rule.text


@pytest.mark.parametrize(
    ("recoveries", "result"),
    [
        ([*[1.5] * 95, *[LATE] * 5], "pass"),
        ([*[1.5] * 94, *[LATE] * 6], "fail"),
        ([*[1.5] * 95, *[LATE] * 4, CUT_OFF], "pass"),
        # the one that was cut off decides, and nobody knows it
        ([*[1.5] * 94, *[LATE] * 5, CUT_OFF], "missing"),
        ([*[1.5] * 93, *[LATE] * 5, CUT_OFF, None], "missing"),
        ([CUT_OFF] * 3, "missing"),
        ([], "missing"),
    ],
)
def test_the_share_of_joints_that_recovered_in_time(
    case: Any, tip: Callable[..., Any], recoveries: Sequence[float | Recovery | None], result: str
) -> None:
    assert the_rule(judged(case, tip, RECOVERED, PortJoints(mixed(recoveries)))).result == result


@pytest.mark.parametrize(
    ("limits", "back", "hidden", "result"),
    [
        (RECOVERED, 1, 0, "pass"),
        (RECOVERED, 1, 1, "missing"),  # one joint was seen, and the rest lies in gaps
        (RECOVERED, 200, 10, "pass"),
        (RECOVERED, 200, 11, "missing"),
        (RECOVERED, 0, 3, "missing"),
        (RECOVERY, 120, 1, "pass"),
        (RECOVERY, 120, 4, "missing"),
        (RECOVERY, 57, 5, "missing"),  # what nobody saw is no evidence
    ],
)
def test_joints_in_gaps_may_be_anything(
    case: Any, tip: Callable[..., Any], limits: Acceptance, back: int, hidden: int, result: str
) -> None:
    rule = the_rule(
        judged(
            case, tip, limits, PortJoints(mixed([1.5] * back), hidden=hidden, unseen_s=3.0 * hidden)
        )
    )
    assert rule.result == result
    assert (f"Joints in {3.0 * hidden:.1f} s of work that was not read" in rule.text) == (
        bool(hidden) and result == "missing"
    )


def test_a_joint_that_was_cut_off_says_nothing_of_recovery(
    case: Any, tip: Callable[..., Any]
) -> None:
    rule = the_rule(judged(case, tip, RECOVERY, PortJoints(mixed([*QUICK, CUT_OFF, CUT_OFF]))))
    assert (rule.result, rule.bound and rule.bound.n) == ("pass", 117)


@pytest.mark.parametrize(
    ("feeds", "result", "verdict"),
    [
        (Feeds(100, 0, 0, 100), "pass", "ACCEPT"),
        (Feeds(98, 0, 0, 100), "pass", "ACCEPT"),
        (Feeds(102, 0, 0, 100), "pass", "ACCEPT"),
        (Feeds(97, 0, 0, 100), "fail", "REJECT"),
        (Feeds(103, 0, 0, 100), "fail", "REJECT"),
        # one may have been counted after the last reading
        (Feeds(103, 1, 0, 100), "missing", "INCONCLUSIVE"),
        (Feeds(97, 0, 1, 100), "missing", "INCONCLUSIVE"),
        (Feeds(97, 1, 0, 100), "fail", "REJECT"),
        # they may have been made while nothing was read
        (Feeds(60, 0, 0, 100, lost_s=40.0), "missing", "INCONCLUSIVE"),
        (Feeds(140, 0, 0, 100, lost_s=40.0), "fail", "REJECT"),  # no gap makes joints
        (Feeds(0, 0, 0, 100), "fail", "REJECT"),
        (Feeds(5, 0, 0, 0), "missing", "INCONCLUSIVE"),
        (
            Feeds(5, 0, 0, None, why="The counter went down: it was reset."),
            "missing",
            "INCONCLUSIVE",
        ),
        (None, "missing", "INCONCLUSIVE"),
    ],
)
def test_joints_against_the_counter(
    case: Any, tip: Callable[..., Any], feeds: Feeds | None, result: str, verdict: str
) -> None:
    judgement = judged(case, tip, COUNTER, PortJoints((), feeds))
    rule = the_rule(judgement)
    assert (rule.result, judgement.verdict, rule.limit_value, rule.uom) == (result, verdict, 2, "%")
    if feeds is not None and feeds.counted:
        assert rule.observed == feeds.found - feeds.counted
    if feeds is not None and feeds.why:
        assert rule.text == feeds.why


@pytest.mark.parametrize("limits", [RECOVERY, RECOVERED, COUNTER])
@pytest.mark.parametrize("seen", [None, PortJoints(why="Its joints could not be looked for.")])
def test_joints_that_were_not_searched_are_missing_evidence(
    case: Any, tip: Callable[..., Any], limits: Acceptance, seen: PortJoints | None
) -> None:
    judgement = judged(case, tip, limits, seen)
    assert (the_rule(judgement).result, judgement.verdict) == ("missing", "INCONCLUSIVE")


@pytest.mark.parametrize(
    ("limits", "family"),
    [
        (RECOVERY, "jtse"),
        (RECOVERED, "omega"),
        (RECOVERY, "omega"),
        (COUNTER, "dde"),
        (COUNTER, "jtse"),
    ],
)
def test_a_station_without_joints_or_feeder_is_not_judged_by_them(
    case: Any, tip: Callable[..., Any], limits: Acceptance, family: str
) -> None:
    judgement = judged(case, tip, limits.model_copy(update={"coverage_percent": 99}), None, family)
    assert (the_rule(judgement).result, judgement.verdict) == ("not applicable", "ACCEPT")


def test_who_does_not_ask_is_not_judged_by_joints(case: Any, tip: Callable[..., Any]) -> None:
    judgement = judged(
        case, tip, Acceptance(coverage_percent=99), PortJoints([9.0] * 100, Feeds(0, 0, 0, 9))
    )
    assert {rule.name for rule in judgement.rules} == {"record", "station", "settings", "coverage"}
