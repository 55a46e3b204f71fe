"""One line of a verdict: limit, observed figure and result; how percentages are judged and
shown.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from math import ceil, floor
from typing import Final

from jbclog.analysis.verdict.bounds import Bound


class Result(StrEnum):
    PASS = "pass"
    FAIL = "fail"
    MISSING = "missing"  # not enough evidence
    DEVIATION = "deviation"  # no limit broken, but not as planned
    NOT_APPLICABLE = "not applicable"  # the station does not report the limited quantity


Figure = float | int | str


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule. `limit_value` and `observed` are numbers in `uom`, or words; None: not known. `text`
    is a sentence for people.

    An estimated figure has a `bound`, which must keep the limit too; a figure counted in full has
    none.
    """

    name: str
    station: str | None
    port: int | None
    limit_value: Figure | None
    observed: Figure | None
    uom: str
    result: Result
    text: str
    bound: Bound | None = None

    def as_dict(self) -> dict[str, object]:
        """Return the rule as in `manifest.verdict_rules` and `report.json`."""
        return {**asdict(self), "result": self.result.value}


@dataclass(frozen=True, slots=True)
class Judged:
    """What a rule comes to, by the facts: figure, result and sentence, and the figure's bound."""

    observed: Figure | None
    result: Result
    text: str
    bound: Bound | None = None


@dataclass(frozen=True, slots=True)
class Asked:
    """What a rule asks: its name, whose it is, and the limit in `uom`."""

    name: str
    station: str
    port: int | None
    limit: Figure
    uom: str

    def rule(self, judged: Judged) -> Rule:
        """Return the rule with what it came to."""
        return Rule(
            self.name,
            self.station,
            self.port,
            self.limit,
            judged.observed,
            self.uom,
            judged.result,
            judged.text,
            judged.bound,
        )

    def not_applicable(self, what: str) -> Rule:
        """Return the rule on a signal that the station does not report."""
        text = f"The station does not report {what}; the limit does not apply."
        return self.rule(Judged(None, Result.NOT_APPLICABLE, text))


RESOLVES: Final = 20
"""With fewer readings than this, the resolution does not excuse a missing one."""


def allowed_misses(due: int, least_percent: float) -> int:
    """Return how many of the readings due may be missing.

    A limit between two counts is the lower one: 99.5 % of 194 readings is 193.03, and 193 keep it.
    100 % is all of them.
    """
    return ceil(due * (100 - least_percent) / 100 - 1e-9)


def floored(percent: float) -> float:
    """Return a percentage with two decimals, rounded down so that it never reaches a missed
    limit.
    """
    return floor(percent * 100 + 1e-9) / 100


def shown(figure: float) -> str:
    """Return a figure with up to two decimals, without trailing zeros."""
    return f"{figure:.2f}".rstrip("0").rstrip(".")
