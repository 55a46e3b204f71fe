"""Whether the tip of a port was verified against an external thermometer, and how long before the run.

The run carries which verification it stood on when it began (`TipCheck` in the manifest). One that failed breaks the limit; none,
one that is too old, one of another tip, or one that was made with another adjustment than the run had is missing evidence.
"""

from __future__ import annotations

from jbclog.analysis.verdict.evidence import Evidence
from jbclog.analysis.verdict.rule import Result, Rule
from jbclog.core.rows import StationFacts, TipCheck

RULE = "verification"
EXPIRED = "expired"
ADJUSTED = "adjusted since"


def verification_rule(facts: StationFacts, port: int, most_days: float, evidence: Evidence, adjusted_c: float | None) -> Rule:
    """The rule of one port; `most_days` is the greatest age at the run's start, `adjusted_c` the run's adjustment."""
    place = (facts.name, port)
    found = next((one for one in evidence.verifications if (one.station, one.port) == place), None)
    observed, result, text = _seen(found, most_days, adjusted_c)
    return Rule(RULE, facts.name, port, most_days, observed, "d", result, text)


def _seen(found: TipCheck | None, most_days: float, adjusted_c: float | None) -> tuple[float | str | None, Result, str]:
    if found is None or found.days is None or found.time is None:
        state = "none" if found is None else found.state
        return state, Result.MISSING, "No valid verification of its tip is known." if found is None else found.text
    made = f"The tip was last verified {_age(found.days)} before the run, at {found.time[:16]}Z, with {found.instrument}"
    if found.state == "fail":
        return "fail", Result.FAIL, f"{made}, and failed: {found.text}"
    if found.state != "pass":
        return found.state, Result.MISSING, found.text
    if found.adjust_c is not None and adjusted_c is not None and found.adjust_c != adjusted_c:
        text = f"{made}, with an adjustment of {found.adjust_c:g} °C; the run had {adjusted_c:g} °C, of which it says nothing."
        return ADJUSTED, Result.MISSING, text
    if found.days > most_days:
        return EXPIRED, Result.MISSING, f"{made}; that is longer ago than the {most_days:g} days that are allowed."
    return found.days, Result.PASS, f"{made}, and passed ({found.offset_c or 0.0:+.1f} °C); {most_days:g} days allowed."


def _age(days: float) -> str:
    return f"{days:.1f} days" if days >= 1 else f"{days * 24:.1f} h"
