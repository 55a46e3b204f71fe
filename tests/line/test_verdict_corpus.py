"""The verdict of each run of the corpus, with each rule, as `tests/data/verdicts/rules` has it.

``pytest tests/line/test_verdict_corpus.py --accept`` writes them anew; the diff is what changed.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from support.records.verdict_corpus import HOME, MORE_RUNS, RUNS, judge_new, rules_text

RULES_OF_RUNS = HOME / "rules"
NAMES = sorted(RUNS | MORE_RUNS)


@pytest.mark.parametrize("name", NAMES)
def test_each_rule_has_the_result_of_the_corpus(
    name: str, tmp_path: Path, pytestconfig: pytest.Config
) -> None:
    now, path = rules_text(judge_new(name, tmp_path)), RULES_OF_RUNS / f"{name}.jsonl"
    if pytestconfig.getoption("--accept"):
        path.write_text(now, encoding="utf-8")
        return
    assert rounded(now) == rounded(path.read_text(encoding="utf-8"))


def rounded(text: str) -> list[object]:
    """The lines with numbers of twelve digits: the last ones of a sum depend on where its array is
    in memory.
    """
    head, *rules = text.splitlines()
    return [
        head,
        *(json.loads(line, parse_float=lambda digits: f"{float(digits):.12g}") for line in rules),
    ]


def test_every_verdict_and_every_result_is_in_the_corpus() -> None:
    texts = [path.read_text(encoding="utf-8").splitlines() for path in RULES_OF_RUNS.iterdir()]
    assert {path.stem for path in RULES_OF_RUNS.iterdir()} == set(NAMES)
    assert {lines[0].partition(",")[0] for lines in texts} == {
        "ACCEPT",
        "ACCEPT WITH DEVIATIONS",
        "REJECT",
        "INCONCLUSIVE",
        "NOT JUDGED",
    }
    results = {json.loads(line)["result"] for lines in texts for line in lines[1:]}
    assert results == {"pass", "fail", "missing", "deviation", "not applicable"}
