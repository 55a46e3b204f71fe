"""A limit that has no bound is not kept; a recipe may ask for bare figures, and then the verdict
says so.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jbclog.analysis.verdict import Judgement, judge
from jbclog.analysis.verdict.rules import JUDGED_BARE
from jbclog.config.load_recipe import load_recipe
from jbclog.config.recipe_sections import Acceptance
from jbclog.core.errors import Problems
from jbclog.report.verdict import FINE, _reasons

RECIPE = """
[recipe]
name = "tht"
revision = 1
families = ["dde"]

[acceptance]
"""


def judged(case: Any, tip: Callable[..., Any], seconds: float, **limits: Any) -> Judgement:
    one = tip(seconds)
    one.temperature = [
        int(value) for value in np.random.default_rng(1).integers(349, 352, len(one.temperature))
    ]
    case.station("a", one)
    return judge(case.evidence(), {"a": Acceptance(idle_error_c=15, idle_sd_c=5, **limits)})


def test_ten_seconds_of_rest_are_no_accept(case: Any, tip: Callable[..., Any]) -> None:
    found = judged(case, tip, 12)
    assert found.verdict == "INCONCLUSIVE"
    (error,) = [rule for rule in found.rules if rule.name == "idle_error"]
    assert error.observed == pytest.approx(0, abs=0.3)
    assert error.text.endswith(
        "A 95 % bound takes 300 s of the tip at rest, and 15 readings; there are 10.0 s."
    )


def test_five_minutes_are_enough(case: Any, tip: Callable[..., Any]) -> None:
    found = judged(case, tip, 303)
    assert found.verdict == "ACCEPT"
    assert all(rule.bound is not None for rule in found.rules if rule.name.startswith("idle"))
    assert "confidence" not in [rule.name for rule in found.rules]


def test_a_recipe_may_judge_bare_figures_and_the_verdict_says_so(
    case: Any, tip: Callable[..., Any]
) -> None:
    found = judged(case, tip, 12, confidence="none")
    assert found.verdict == "ACCEPT"
    reasons = [reason.text for reason in _reasons(found.verdict, found.rules_as_dicts())]
    assert reasons == [f"a: {JUDGED_BARE}", FINE]


def test_a_bare_figure_that_breaks_its_limit_is_rejected(
    case: Any, tip: Callable[..., Any]
) -> None:
    one = tip(12)
    one.temperature = [380] * 120
    case.station("a", one)
    found = judge(case.evidence(), {"a": Acceptance(idle_error_c=15, confidence="none")})
    assert found.verdict == "REJECT"
    assert JUDGED_BARE in _reasons(found.verdict, found.rules_as_dicts()).__next__().text


@pytest.mark.parametrize(
    ("line", "confidence"),
    [("", 0.95), ("confidence = 0.95\n", 0.95), ('confidence = "none"\n', "none")],
)
def test_a_recipe_says_it(tmp_path: Path, line: str, confidence: float | str) -> None:
    path = tmp_path / "tht.toml"
    path.write_text(f"{RECIPE}idle_sd_c = 5\n{line}")
    acceptance = load_recipe(path).acceptance
    assert acceptance is not None
    assert acceptance.confidence == confidence


@pytest.mark.parametrize("value", ["0.9", '"low"', "1", "true"])
def test_no_other_confidence_is_taken(tmp_path: Path, value: str) -> None:
    path = tmp_path / "tht.toml"
    path.write_text(f"{RECIPE}idle_sd_c = 5\nconfidence = {value}\n")
    with pytest.raises(Problems, match=r"must be 0.95 or \"none\""):
        load_recipe(path)


def test_it_is_no_limit_by_itself(tmp_path: Path) -> None:
    path = tmp_path / "tht.toml"
    path.write_text(f"{RECIPE}confidence = 0.95\n")
    with pytest.raises(Problems, match="names no limit"):
        load_recipe(path)
