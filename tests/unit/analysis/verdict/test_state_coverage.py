"""Coverage of what an OMEGA tells: answers without a digit are no state, and what it does not
answer is not due.
"""

from __future__ import annotations

import pytest

from jbclog.analysis.verdict.port_rules import coverage_rule
from jbclog.analysis.verdict.rule import Result
from jbclog.analysis.verdict.samples import PortMeasure
from jbclog.core.rows import StationFacts

Counts = dict[str, dict[str, int]]
BARE = {"due": 10, "ok": 0, "no_digit": 9, "timeout": 1}


@pytest.mark.parametrize(
    ("ledger", "readings", "result", "text"),
    [
        ({"solder_shortage": BARE}, 0, Result.MISSING, "Every answer lacked the digit"),
        (
            {"solder_shortage": BARE, "preparing": {"due": 10, "ok": 10}},
            10,
            Result.PASS,
            "10 of 10",
        ),
        ({"solder_shortage": {"due": 10, "ok": 4, "no_digit": 6}}, 4, Result.FAIL, "4 of 10"),
        ({"solder_shortage": {"due": 10, "ok": 10}}, 10, Result.PASS, "10 of 10"),
        ({"solder_shortage": {"due": 10, "ok": 0, "timeout": 10}}, 0, Result.FAIL, "0 of 10"),
        ({}, 0, Result.MISSING, "no reading was due"),
    ],
)
def test_a_signal_that_is_never_reported_is_not_known_and_a_lost_reading_is_missed(
    ledger: Counts, readings: int, result: Result, text: str
) -> None:
    facts = StationFacts(
        "omega-1", "url", "omega", signals=["solder_shortage", "preparing", "in_range"]
    )
    rule = coverage_rule(facts, 1, 90.0, ledger, PortMeasure(1.0, readings=readings))
    assert rule.result is result
    assert text in rule.text
