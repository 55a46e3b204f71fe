"""The rules about joints: recovery time, share recovered before the next joint, and joints against
the feeder's counter.

*Recovery* is judged by the 95 % quantile over a port's joints and its upper bound (`quantiles.py`).
A joint's recovery is the time from its start until the tip is back at its resting level
(`analysis/joints/recovery.py`). A joint that the next one interrupts is censored in the quantile
and counts as longer than any other in the bound, like one whose recovery is not known. If more than
5 % are known to exceed the limit, it is broken. Joints that the record cuts off do not count.

*Recovered before the next* is the share of all joints of the run after which the tip recovered in
time. Joints that were cut off, and joints that gaps may hide (one in each gap, or as many as in the
rest of the time), can be either; the limit is kept only if it is kept both ways. In the bound of
the recovery they count as longer, too.

*Joints against the counter* is the number of joints found minus the dispensing cycles counted
(R-DC), in per cent of the latter, between the first and last reading of the counter; it assumes one
feed per joint. A difference that joints in a gap, or close to one of these readings, can explain is
missing evidence.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from jbclog.analysis.port_data import has_tip
from jbclog.analysis.verdict.acceptance import is_bare
from jbclog.analysis.verdict.evidence import (
    Evidence,
    Feeds,
    PortJoints,
    joints_not_known,
    not_read,
)
from jbclog.analysis.verdict.quantiles import SHARE, censored_quantile, upper_p95
from jbclog.analysis.verdict.rule import Asked, Judged, Result, Rule
from jbclog.analysis.verdict.rules import has_feeder
from jbclog.core.rows import StationFacts
from jbclog.core.text import count_text

if TYPE_CHECKING:  # importing pydantic for a verdict would be slow
    from jbclog.config.recipe_sections import Acceptance

RECOVERY = "recovery_p95"
RECOVERED = "recovered_before_next"
AGAINST_COUNTER = "joints_against_counter"
NOT_SOUGHT = PortJoints(why="Joints were not searched.")


def joint_rules(
    facts: StationFacts, port: int, acceptance: Acceptance, evidence: Evidence
) -> Iterator[Rule]:
    """Yield the rules on a port's joints that its recipe states."""
    seen = evidence.joints.get((facts.name, port), NOT_SOUGHT)
    if acceptance.recovery_p95_s is not None:
        yield recovery_rule(facts, port, acceptance.recovery_p95_s, seen, bare=is_bare(acceptance))
    if acceptance.recovered_before_next_percent is not None:
        yield recovered_rule(facts, port, acceptance.recovered_before_next_percent, seen)
    if acceptance.joints_against_counter_percent is not None:
        yield counter_rule(facts, port, acceptance.joints_against_counter_percent, seen)


def _unknown(seen: PortJoints) -> str | None:
    """Return why joints, or some of them, are not known; None if all are known."""
    if seen.why is None:
        return None
    return joints_not_known(seen.why, are_some=bool(seen.recoveries))


def _none_known(seen: PortJoints) -> str:
    none = "The recovery of no joint is known." if seen.recoveries else "No joints were found."
    return f"{none} {not_read(seen.unseen_s)}" if seen.hidden else none


def recovery_rule(
    facts: StationFacts, port: int, most_s: float, seen: PortJoints, *, bare: bool = False
) -> Rule:
    """Return the rule on the 95 % quantile of recovery."""
    asked = Asked(RECOVERY, facts.name, port, most_s, "s")
    if not has_tip(facts):
        return asked.not_applicable("joints")
    return asked.rule(_judge_recovery(most_s, seen, bare=bare))


def _judge_recovery(most_s: float, seen: PortJoints, *, bare: bool) -> Judged:
    known = [one for one in seen.recoveries if one is not None]
    decided = [one for one in known if one.back is not None]
    if not decided or seen.why is not None:
        text = _unknown(seen) or _none_known(seen)
        return Judged(None, Result.MISSING, text)
    value = censored_quantile([(one.seconds, bool(one.back)) for one in known], SHARE)
    if value is not None:
        return _judge_quantile(most_s, round(value, 6), seen, bare=bare)
    late = sum(one.back is False for one in decided)
    longer = sum(one.seconds > most_s for one in decided)
    text = f"After {late} of {len(decided)} joints the next one began before the tip recovered."
    if longer > (1 - SHARE) * len(decided):
        text = f"{text} {longer} took longer than the {most_s:g} s allowed."
        return Judged(None, Result.FAIL, text)
    return Judged(None, Result.MISSING, f"{text} Their recovery is not known.")


def _judge_quantile(most_s: float, value: float, seen: PortJoints, *, bare: bool) -> Judged:
    """Judge the 95 % quantile with its bound."""
    counted = [one for one in seen.recoveries if one is None or one.back is not None]
    times = [one.seconds if one is not None and one.back else None for one in counted]
    bound = upper_p95(times)
    if seen.hidden and not isinstance(bound, str):
        bound = upper_p95([*times, *[None] * seen.hidden])
    text = (
        f"95 % of {count_text(len(counted), 'joint')} recovered within {value:.2f} s, allowed"
        f" {most_s:g} s."
    )
    known = None if isinstance(bound, str) else bound
    if value > most_s:
        return Judged(value, Result.FAIL, text, known)
    if bare:
        return Judged(value, Result.PASS, text, known)
    if isinstance(bound, str):
        text = f"{text} {bound}"
        if seen.hidden:
            text = f"{text} {not_read(seen.unseen_s)}"
        return Judged(value, Result.MISSING, text)
    if bound.keeps(most_s):
        return Judged(value, Result.PASS, text, bound)
    text = f"{text} The 95 % bound is {bound.high:.2f} s: more joints are needed."
    return Judged(value, Result.MISSING, text, bound)


def recovered_rule(facts: StationFacts, port: int, least: float, seen: PortJoints) -> Rule:
    """Return the rule on the share of joints that recovered before the next."""
    asked = Asked(RECOVERED, facts.name, port, least, "%")
    if not has_tip(facts):
        return asked.not_applicable("joints")
    return asked.rule(_judge_recovered(least, seen))


def _judge_recovered(least: float, seen: PortJoints) -> Judged:
    back = sum(one is not None and one.back is True for one in seen.recoveries)
    late = sum(one is not None and one.back is False for one in seen.recoveries)
    joints = len(seen.recoveries) + seen.hidden
    undecided = joints - back - late
    if seen.why is not None or not back + late:
        text = _unknown(seen) or _none_known(seen)
        return Judged(None, Result.MISSING, text)
    percent = 100 * back / (back + late)
    text = (
        f"Recovered before the next joint: {back} of {count_text(back + late, 'joint')},"
        f" required {least:g} %."
    )
    if 100 * (back + undecided) / joints < least:
        return Judged(percent, Result.FAIL, text)
    if 100 * back / joints >= least or not undecided:
        return Judged(percent, Result.PASS, text)
    cut = undecided - seen.hidden
    if cut:
        text = f"{text} {cut} more {'were' if cut != 1 else 'was'} cut off and may change that."
    if seen.hidden:
        text = f"{text} {not_read(seen.unseen_s)}"
    return Judged(percent, Result.MISSING, text)


def counter_rule(facts: StationFacts, port: int, most: float, seen: PortJoints) -> Rule:
    """Return the rule that compares joints with the feeder's counter."""
    asked = Asked(AGAINST_COUNTER, facts.name, port, most, "%")
    if not has_feeder(facts):
        return asked.not_applicable("dispensing cycles")
    return asked.rule(_judge_counter(most, seen))


def _judge_counter(most: float, seen: PortJoints) -> Judged:
    feeds = seen.feeds
    if seen.why is not None or feeds is None or not feeds.counted:
        return Judged(None, Result.MISSING, _unknown(seen) or _nothing_counted(feeds))
    percent = 100 * (feeds.found - feeds.counted) / feeds.counted
    text = (
        f"{feeds.found} joints found, {feeds.counted} feeds counted: {percent:+.2f} %, allowed"
        f" ±{most:g} %."
    )
    if abs(percent) <= most:
        return Judged(percent, Result.PASS, text)
    excuse = _excuse(feeds, most)
    if excuse:
        return Judged(percent, Result.MISSING, f"{text} {excuse}")
    return Judged(percent, Result.FAIL, text)


def _nothing_counted(feeds: Feeds | None) -> str:
    if feeds is None:
        return "The feeder's counter was not read."
    return feeds.why or "Nothing was fed."


def _excuse(feeds: Feeds, most: float) -> str | None:
    """Return an explanation of the difference other than a miscount, or None."""
    counted = feeds.counted or 0
    allowed = counted * most / 100
    least, highest = feeds.found - feeds.at_edges, feeds.found + feeds.beyond
    if least - allowed <= counted <= highest + allowed:
        return "Joints at the first or the last reading of the counter can explain it."
    if feeds.lost_s and least - allowed <= counted:
        return f"Nothing was read for {feeds.lost_s:.1f} s; joints in that time can explain it."
    return None
