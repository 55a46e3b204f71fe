"""One line of a verdict: what was asked, what was found, and a sentence that says so."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum

from jbclog.analysis.verdict.bounds import Bound


class Result(StrEnum):
    PASS = "pass"
    FAIL = "fail"
    MISSING = "missing"  # there is not enough evidence to say
    DEVIATION = "deviation"  # no limit was broken, and it was not as planned
    NOT_APPLICABLE = "not applicable"  # the station tells nothing that the limit is about


Figure = float | int | str


@dataclass(frozen=True, slots=True)
class Rule:
    """`limit` and `observed` are numbers in `unit` where they can be, else words; None: not known.

    `bound` is there where the figure is an estimate; what was counted in full needs none. A limit is kept by the bound, too,
    or it is not known to be kept.
    """

    name: str
    station: str | None
    port: int | None
    limit: Figure | None
    observed: Figure | None
    unit: str
    result: Result
    text: str
    bound: Bound | None = None

    def as_dict(self) -> dict[str, object]:
        """For `manifest.verdict_rules` and `report.json`."""
        return {**asdict(self), "result": self.result.value}
