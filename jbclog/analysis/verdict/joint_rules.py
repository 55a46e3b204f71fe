"""The rules about joints: how long the tip takes to be back, how often it is, and whether the feeder counted as many.

*Recovery* is judged by the 95 % quantile over the joints of a port and by its upper bound (`quantile`): that of a joint is the
time from its start until the tip is back at the level at which it rests (`analysis/joints/recovery.py`). A joint that the next one
followed before that took longer than the time it had: it is censored in the quantile (`censored`) and counts as longer than any in
the bound, as does one of which nothing is known; where more than 5 % are known to have taken longer than the limit, it is broken.
What the record cut off says nothing.

*Recovered before the next*: the share of the joints after which the tip was back in time. It is no sample but all joints of the
run; those that were cut off may be either, and the limit has to be kept whichever they are. So may those that nobody could see: one
in each gap of the record, or as many as in the rest of the time. In the bound of the recovery these count as longer, too.

*Joints against the counter*: joints found minus dispensing cycles counted (R-DC), in per cent of these, between the first and the
last reading of the counter; it holds where one feed makes one joint. A difference that joints in a gap of the record, or so near
to a reading that their side is not known, can explain is missing evidence and breaks no limit.
"""

from __future__ import annotations

from collections.abc import Iterator

from jbclog.analysis.verdict.acceptance import Acceptance, is_bare
from jbclog.analysis.verdict.bounds import SHARE, censored_quantile, upper_p95
from jbclog.analysis.verdict.evidence import Evidence, Feeds, PortJoints, not_read
from jbclog.analysis.verdict.rule import Result, Rule
from jbclog.analysis.verdict.rules import has_feeder, has_tip, not_applicable
from jbclog.core.rows import StationFacts

RECOVERY, RECOVERED, AGAINST_COUNTER = "recovery_p95", "recovered_before_next", "joints_against_counter"
NOT_SOUGHT = PortJoints(why="Joints were not searched.")


def joint_rules(facts: StationFacts, port: int, acceptance: Acceptance, evidence: Evidence) -> Iterator[Rule]:
    """The rules about the joints of one port, as far as its recipe asks for them."""
    seen = evidence.joints.get((facts.name, port), NOT_SOUGHT)
    if acceptance.recovery_p95_s is not None:
        yield recovery_rule(facts, port, acceptance.recovery_p95_s, seen, bare=is_bare(acceptance))
    if acceptance.recovered_before_next_percent is not None:
        yield recovered_rule(facts, port, acceptance.recovered_before_next_percent, seen)
    if acceptance.joints_against_counter_percent is not None:
        yield counter_rule(facts, port, acceptance.joints_against_counter_percent, seen)


def _unknown(seen: PortJoints) -> str | None:
    """That joints are not known, or not all of them, and why; None where they are."""
    if seen.why is None:
        return None
    return f"{'Not all joints are' if seen.recoveries else 'Joints are not'} known: {seen.why[:1].lower()}{seen.why[1:]}"


def _none_known(seen: PortJoints) -> str:
    none = "The recovery of no joint is known." if seen.recoveries else "No joints were found."
    return f"{none} {not_read(seen.unseen_s)}" if seen.hidden else none


def recovery_rule(facts: StationFacts, port: int, most_s: float, seen: PortJoints, *, bare: bool = False) -> Rule:
    """How long the tip takes to be back, 95 joints of 100."""
    if not has_tip(facts):
        return not_applicable(RECOVERY, facts.name, port, most_s, "s", "joints")
    told = [one for one in seen.recoveries if one is not None]
    decided = [one for one in told if one.back is not None]
    if not decided or seen.why is not None:
        text = _unknown(seen) or _none_known(seen)
        return Rule(RECOVERY, facts.name, port, most_s, None, "s", Result.MISSING, text)
    late = sum(one.back is False for one in decided)
    value = censored_quantile([(one.seconds, bool(one.back)) for one in told], SHARE)
    longer = sum(one.seconds > most_s for one in decided)
    if value is None:
        text = f"After {late} of {len(decided)} joints the next one began before the tip recovered."
        is_broken = longer > (1 - SHARE) * len(decided)
        text = (
            f"{text} {longer} took longer than the {most_s:g} s allowed." if is_broken else f"{text} Their recovery is not known."
        )
        return Rule(RECOVERY, facts.name, port, most_s, None, "s", Result.FAIL if is_broken else Result.MISSING, text)
    return _bounded_recovery(facts, port, most_s, round(value, 6), seen, bare)


def _bounded_recovery(facts: StationFacts, port: int, most_s: float, value: float, seen: PortJoints, bare: bool) -> Rule:
    """The rule with the bound of its quantile."""
    counted = [one for one in seen.recoveries if one is None or one.back is not None]
    hidden = [None] * seen.hidden
    told = [one.seconds if one is not None and one.back else None for one in counted]
    bound = upper_p95(told)
    bound = upper_p95([*told, *hidden]) if hidden and not isinstance(bound, str) else bound
    text = f"95 % of {_joints(len(counted))} recovered within {value:.2f} s, allowed {most_s:g} s."
    if value > most_s:
        kept = None if isinstance(bound, str) else bound
        return Rule(RECOVERY, facts.name, port, most_s, value, "s", Result.FAIL, text, kept)
    if bare:
        return Rule(RECOVERY, facts.name, port, most_s, value, "s", Result.PASS, text, None if isinstance(bound, str) else bound)
    if isinstance(bound, str):
        text = f"{text} {bound} {not_read(seen.unseen_s)}" if seen.hidden else f"{text} {bound}"
        return Rule(RECOVERY, facts.name, port, most_s, value, "s", Result.MISSING, text)
    if not bound.keeps(most_s):
        text = f"{text} The 95 % bound is {bound.high:.2f} s: more joints are needed."
        return Rule(RECOVERY, facts.name, port, most_s, value, "s", Result.MISSING, text, bound)
    return Rule(RECOVERY, facts.name, port, most_s, value, "s", Result.PASS, text, bound)


def recovered_rule(facts: StationFacts, port: int, least: float, seen: PortJoints) -> Rule:
    """After how many joints the tip is back before the next one."""
    if not has_tip(facts):
        return not_applicable(RECOVERED, facts.name, port, least, "%", "joints")
    back = sum(one is not None and one.back is True for one in seen.recoveries)
    late = sum(one is not None and one.back is False for one in seen.recoveries)
    joints = len(seen.recoveries) + seen.hidden
    open_ = joints - back - late
    if seen.why is not None or not back + late:
        text = _unknown(seen) or _none_known(seen)
        return Rule(RECOVERED, facts.name, port, least, None, "%", Result.MISSING, text)
    percent = 100 * back / (back + late)
    text = f"Recovered before the next joint: {back} of {_joints(back + late)}, required {least:g} %."
    if 100 * (back + open_) / joints < least:
        result = Result.FAIL
    elif 100 * back / joints >= least or not open_:
        result = Result.PASS
    else:
        cut = open_ - seen.hidden
        result, text = (
            Result.MISSING,
            f"{text} {cut} more {'were' if cut != 1 else 'was'} cut off and may change that." if cut else text,
        )
        text = f"{text} {not_read(seen.unseen_s)}" if seen.hidden else text
    return Rule(RECOVERED, facts.name, port, least, percent, "%", result, text)


def _joints(count: int) -> str:
    return f"{count} joint{'s' * (count != 1)}"


def counter_rule(facts: StationFacts, port: int, most: float, seen: PortJoints) -> Rule:
    """Whether as many joints were found as the feeder counted feeds."""
    if not has_feeder(facts):
        return not_applicable(AGAINST_COUNTER, facts.name, port, most, "%", "dispensing cycles")
    feeds = seen.feeds
    if seen.why is not None or feeds is None or not feeds.counted:
        text = _unknown(seen) or ("The feeder's counter was not read." if feeds is None else feeds.why or "Nothing was fed.")
        return Rule(AGAINST_COUNTER, facts.name, port, most, None, "%", Result.MISSING, text)
    percent = 100 * (feeds.found - feeds.counted) / feeds.counted
    text = f"{feeds.found} joints found, {feeds.counted} feeds counted: {percent:+.2f} %, allowed ±{most:g} %."
    if abs(percent) <= most:
        result = Result.PASS
    elif excuse := _excuse(feeds, most):
        result, text = Result.MISSING, f"{text} {excuse}"
    else:
        result = Result.FAIL
    return Rule(AGAINST_COUNTER, facts.name, port, most, percent, "%", result, text)


def _excuse(feeds: Feeds, most: float) -> str | None:
    """What else than a miscount can explain the difference; None where nothing can."""
    counted = feeds.counted or 0
    allowed = counted * most / 100
    least, highest = feeds.found - feeds.at_edges, feeds.found + feeds.beyond
    if least - allowed <= counted <= highest + allowed:
        return "Joints at the first or the last reading of the counter can explain it."
    if feeds.lost_s and least - allowed <= counted:
        return f"Nothing was read for {feeds.lost_s:.1f} s; joints in that time can explain it."
    return None
