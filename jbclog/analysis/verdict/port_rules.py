"""The rules on the readings of one port: coverage, longest gap, idle tip, setpoint reached, tip
verification.

A reading that the computer skipped is missing evidence and breaks no limit. A percentage is judged
with the resolution of the run: one missing reading of few does not break it. An estimated figure
keeps its limit only together with its 95 % bound.

A run names the verification of each tip that was valid when it began (`TipCheck` in the manifest).
A failed one breaks the limit; none, one that is too old, of another tip, or made with another
adjustment than the run's is missing evidence.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jbclog.analysis.port_data import TEMPERATURE
from jbclog.analysis.verdict.acceptance import REACHED_LIMITS, is_bare
from jbclog.analysis.verdict.bounds import Bound
from jbclog.analysis.verdict.evidence import Evidence, PortLedger
from jbclog.analysis.verdict.idle import NOT_IDLE, IdleError
from jbclog.analysis.verdict.reached import (
    AT_WORK_PERCENT,
    ORDERS_WORK,
    WITHIN_C,
    Limit,
    Targets,
    judge_heat,
)
from jbclog.analysis.verdict.reached import RULE as REACHED
from jbclog.analysis.verdict.rule import (
    RESOLVES,
    Asked,
    Judged,
    Result,
    Rule,
    allowed_misses,
    floored,
    shown,
)
from jbclog.analysis.verdict.rules import reports
from jbclog.analysis.verdict.samples import SKIPPED, PortMeasure, judged_signals
from jbclog.core.rows import StationFacts, TipCheck

if TYPE_CHECKING:  # importing pydantic for a verdict would be slow
    from jbclog.config.recipe_sections import Acceptance

EXPIRED = "expired"
ADJUSTED = "adjusted since"
NO_STATE = "Every answer lacked the digit of the state, so no state is known."


def port_rules(
    facts: StationFacts,
    port: int,
    acceptance: Acceptance,
    ledger: PortLedger,
    measure: PortMeasure | None,
) -> Iterator[Rule]:
    """Yield the rules on a port, in reading order."""
    if acceptance.coverage_percent is not None:
        yield coverage_rule(facts, port, acceptance.coverage_percent, ledger, measure)
    if acceptance.longest_gap_s is not None:
        asked = Asked("longest_gap", facts.name, port, acceptance.longest_gap_s, "s")
        yield asked.rule(_judge_gap(facts, acceptance.longest_gap_s, ledger, measure))
    yield from idle_rules(facts, port, acceptance, measure)


def heat_rules(
    facts: StationFacts,
    port: int,
    acceptance: Acceptance,
    evidence: Evidence,
    measure: PortMeasure | None,
    *,
    is_ordered: bool,
) -> Iterator[Rule]:
    """Yield the rule `reached` if the recipe sets a temperature or states such a limit."""
    targets = evidence.targets.get(facts.name, Targets())
    is_stated = any(getattr(acceptance, name) is not None for name in REACHED_LIMITS)
    if port not in targets.heated and not is_stated:
        return
    percent = acceptance.at_work_percent
    if percent is None:
        percent = AT_WORK_PERCENT
    asked = Asked(REACHED, facts.name, port, percent, "%")
    if not reports(facts, TEMPERATURE):
        yield asked.not_applicable("temperature")
        return
    within = acceptance.reached_within_c
    if within is None:
        within = WITHIN_C
    limit = Limit(within, percent, is_ordered and targets.status in ORDERS_WORK)
    yield asked.rule(judge_heat(limit, targets, None if measure is None else measure.heat))


def idle_rules(
    facts: StationFacts, port: int, acceptance: Acceptance, measure: PortMeasure | None
) -> Iterator[Rule]:
    """Yield the rules on idle error and idle standard deviation."""
    idle = IdleError() if measure is None else measure.idle
    bounds = idle.bounds()
    of_mean = bounds if isinstance(bounds, str) else bounds.mean
    of_sd = bounds if isinstance(bounds, str) else bounds.sd
    is_judged_bare = is_bare(acceptance)
    for name, limit in (("idle_error", acceptance.idle_error_c), ("idle_sd", acceptance.idle_sd_c)):
        if limit is None:
            continue
        asked = Asked(name, facts.name, port, limit, "°C")
        if not reports(facts, TEMPERATURE):
            yield asked.not_applicable("temperature")
        elif idle.mean_c is None or idle.sd_c is None:
            yield asked.rule(Judged(None, Result.MISSING, NOT_IDLE))
        elif name == "idle_error":
            text = (
                f"Idle error {round(idle.mean_c, 1) + 0.0:+.1f} °C (mean),"
                f" allowed ±{shown(limit)} °C."
            )
            yield asked.rule(judge_bounded(idle.mean_c, limit, text, of_mean, bare=is_judged_bare))
        else:
            text = f"Idle standard deviation {shown(idle.sd_c)} °C, allowed {shown(limit)} °C."
            yield asked.rule(judge_bounded(idle.sd_c, limit, text, of_sd, bare=is_judged_bare))


def judge_bounded(
    figure: float, limit: float, text: str, bound: Bound | str, *, bare: bool = False
) -> Judged:
    """Judge a figure in °C with its bound, or with the sentence why there is none.

    The limit is kept if figure and bound keep it. If only the figure keeps it, or there is no
    bound, evidence is missing, unless figures are judged `bare`.
    """
    known = None if isinstance(bound, str) else bound
    if abs(figure) > limit:
        return Judged(figure, Result.FAIL, text, known)
    if bare:
        return Judged(figure, Result.PASS, text, known)
    if isinstance(bound, str):
        return Judged(figure, Result.MISSING, f"{text} {bound}")
    if bound.keeps(limit):
        return Judged(figure, Result.PASS, text, bound)
    text += f" The 95 % bound is {shown(_furthest(bound))} °C: a longer record is needed."
    return Judged(figure, Result.MISSING, text, bound)


def _furthest(bound: Bound) -> float:
    return bound.high if bound.low is None else max(bound.low, bound.high, key=abs)


@dataclass(frozen=True, slots=True)
class Coverage:
    """Readings due, readings obtained, and those that the computer, not the station, lost."""

    due: int
    obtained: int
    late_host: int

    @property
    def percent(self) -> float:
        return 100 * self.obtained / self.due

    @property
    def missing(self) -> int:
        return self.due - self.obtained

    def result(self, least_percent: float) -> Result:
        """Judge it with the run's resolution. What the computer lost breaks no limit."""
        allowed = allowed_misses(self.due, least_percent)
        if self.missing - self.late_host > allowed:
            return Result.FAIL
        if self.missing > allowed:  # the station may have kept the limit
            return Result.MISSING
        if self.due < RESOLVES and self.percent < least_percent:
            return Result.MISSING
        return Result.PASS


def coverage_rule(
    facts: StationFacts, port: int, least: float, ledger: PortLedger, measure: PortMeasure | None
) -> Rule:
    """Return the rule on readings of temperature or state obtained, in per cent of those due."""
    asked = Asked("coverage", facts.name, port, least, "%")
    what = _what_is_read(facts)
    counts = _judged_counts(facts, ledger)
    due = sum(signal.get("due", 0) for signal in counts)
    counted = sum(signal.get("ok", 0) for signal in counts)
    readings = 0 if measure is None else measure.readings
    if not due:
        why = f"{what}: no reading was due."
        if _any_says_no_state(facts, ledger):
            why = NO_STATE
        return asked.rule(Judged(None, Result.MISSING, why))
    if readings != counted:
        text = f"{what}: the accounting has {counted} readings, the samples {readings}."
        return asked.rule(Judged(None, Result.MISSING, text))
    late_host = sum(skipped_by_host(facts, signal.get(SKIPPED, 0)) for signal in counts)
    coverage = Coverage(due, readings, late_host)
    result = coverage.result(least)
    sentences = [
        f"{what} coverage {shown(floored(coverage.percent))} % ({readings} of {due}),"
        f" required {shown(least)} %.",
        *_remarks(coverage, least, result),
    ]
    return asked.rule(Judged(coverage.percent, result, " ".join(sentences)))


def _remarks(coverage: Coverage, least: float, result: Result) -> Iterator[str]:
    """Yield what has to be known beside the figure."""
    if result is Result.PASS:
        if coverage.percent < least:
            yield f"One reading is {shown(100 / coverage.due)} %: within the resolution."
        return
    if coverage.late_host:
        yield f"The recorder was too late for {coverage.late_host} of them (busy or stopped)."
    if result is Result.FAIL:
        return
    if coverage.missing <= allowed_misses(coverage.due, least):
        yield f"{coverage.due} readings are too few to decide."
    else:
        yield "Their values are not known; less load on the computer, or a lower rate, helps."


def _judged_counts(facts: StationFacts, ledger: PortLedger) -> Sequence[Mapping[str, int]]:
    """Return the accounting of each judged signal; leaves out a signal that never had a state."""
    counts = [ledger.get(signal, {}) for signal in judged_signals(facts)]
    return [signal for signal in counts if not says_no_state(signal)]


def _any_says_no_state(facts: StationFacts, ledger: PortLedger) -> bool:
    return any(says_no_state(ledger.get(signal, {})) for signal in judged_signals(facts))


def says_no_state(counts: Mapping[str, int]) -> bool:
    """Whether every answer lacked a state: an OMEGA that answers `a` alone (manual 003, 11.3.1).

    Such a signal is not judged.
    """
    return bool(counts.get("no_digit")) and not counts.get("ok")


def skipped_by_host(facts: StationFacts, skipped: int) -> int:
    """Return how many of a signal's skipped readings the computer caused; all of them if the record
    does not say.
    """
    if facts.skipped_by_host is None:
        return skipped
    return min(skipped, facts.skipped_by_host + facts.skipped)


def _judge_gap(
    facts: StationFacts, most_s: float, ledger: PortLedger, measure: PortMeasure | None
) -> Judged:
    """Judge the longest gap, which may be a period longer than the limit: any two readings are a
    period apart. If only readings that the computer skipped break the limit, evidence is missing.
    """
    if measure is None or measure.gap_s is None:
        text = NO_STATE if _any_says_no_state(facts, ledger) else "Nothing was recorded."
        return Judged(None, Result.MISSING, text)
    what = "temperature" if reports(facts, TEMPERATURE) else "readings"
    allowed = f"{shown(most_s)} s"
    if measure.period_s:
        allowed += f" and a period of {shown(measure.period_s)} s"
    text = f"Longest gap in {what} {shown(round(measure.gap_s, 1))} s, allowed {allowed}."
    if (measure.lost_s or 0.0) <= most_s:
        return Judged(measure.gap_s, Result.PASS, text)
    if (measure.lost_of_others_s or 0.0) > most_s:
        return Judged(measure.gap_s, Result.FAIL, text)
    others = shown(round(measure.gap_of_others_s or 0.0, 1))
    text += (
        f" The recorder was too late for some readings (busy or stopped); without these it is"
        f" {others} s."
    )
    return Judged(measure.gap_s, Result.MISSING, text)


def _what_is_read(facts: StationFacts) -> str:
    if not reports(facts, TEMPERATURE):
        return "State"
    return "Air temperature" if "external_c" in facts.signals else "Tip temperature"


def verification_rule(
    facts: StationFacts, port: int, most_days: float, evidence: Evidence, adjusted_c: float | None
) -> Rule:
    """Return the rule on a port's tip verification.

    `most_days`: the maximum age at the run's start. `adjusted_c`: the adjustment that the run had,
    °C; None if not read.
    """
    found = None
    for check in evidence.verifications:
        if (check.station, check.port) == (facts.name, port):
            found = check
            break
    asked = Asked("verification", facts.name, port, most_days, "d")
    return asked.rule(_judge_verification(found, most_days, adjusted_c))


def _judge_verification(
    found: TipCheck | None, most_days: float, adjusted_c: float | None
) -> Judged:
    if found is None:
        return Judged("none", Result.MISSING, "No valid verification of its tip.")
    if found.days is None or found.time is None:
        return Judged(found.state, Result.MISSING, found.text)
    verified = (
        f"The tip was last verified {_age(found.days)} before the run, at {found.time[:16]}Z, with"
        f" {found.instrument}"
    )
    if found.state == "fail":
        return Judged("fail", Result.FAIL, f"{verified}, and failed: {found.text}")
    if found.state != "pass":
        return Judged(found.state, Result.MISSING, found.text)
    if found.adjust_c is not None and adjusted_c is not None and found.adjust_c != adjusted_c:
        text = (
            f"{verified}, with an adjustment of {found.adjust_c:g} °C; the run had"
            f" {adjusted_c:g} °C."
        )
        return Judged(ADJUSTED, Result.MISSING, text)
    if found.days > most_days:
        text = f"{verified}: too long ago, {most_days:g} days allowed."
        return Judged(EXPIRED, Result.MISSING, text)
    offset = f"{found.offset_c or 0.0:+.1f} °C"
    text = f"{verified}, and passed ({offset}); {most_days:g} days allowed."
    return Judged(found.days, Result.PASS, text)


def _age(days: float) -> str:
    return f"{days:.1f} days" if days >= 1 else f"{days * 24:.1f} h"
