"""Runs that the rules of this version judged are judged again; of those by other rules `check` says
that it does not have them.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.analysis.rejudge import check_verdict, judge_again
from jbclog.analysis.verdict import RULES
from jbclog.record.manifest import read_manifest, write_manifest
from jbclog.report.write import write_report
from support.invoked import invoked
from support.records.small_run import make_run
from support.records.verdict_corpus import HOME, judged, record, unpack

ARCHIVES = sorted(HOME.glob("*.tar.xz"))
NOTED = json.loads((HOME / "noted.json").read_text())
OF_OTHER_RULES = "judged by rules 1, which this version does not have"
every_run = pytest.mark.parametrize(
    "archive", ARCHIVES, ids=lambda path: str(path.name).split(".")[0]
)


RunOf = Callable[[str, Path], Path]
"""Copies one of the kept runs below a folder."""


def said_by(*words: object) -> tuple[int, str]:
    result = invoked(*words)
    return result.exit_code, result.output


# -- by other rules --------------------------------------------------------------------------------


def test_every_verdict_is_among_them() -> None:
    verdicts = {one["verdict"] for one in NOTED.values()}
    assert verdicts == {"ACCEPT", "ACCEPT WITH DEVIATIONS", "REJECT", "INCONCLUSIVE", "NOT JUDGED"}
    assert {path.name.split(".")[0] for path in ARCHIVES} == set(NOTED)


@every_run
def test_check_says_that_this_version_does_not_have_its_rules(
    archive: Path, tmp_path: Path
) -> None:
    folder = unpack(archive, tmp_path)
    assert judged(folder) == NOTED[archive.name.split(".")[0]]
    code, said = said_by("check", folder)
    *before, last = said.splitlines()
    assert (code, last.startswith(f"{folder}: no differences")) == (0, True)
    assert [line for line in before if line.startswith("not covered: ") is False] == (
        []
        if read_manifest(folder).exit_status == "lost"
        else [f"verdict: {OF_OTHER_RULES}; its record is intact"]
    )


@every_run
def test_a_report_of_it_has_the_verdict_of_then(archive: Path, tmp_path: Path) -> None:
    folder = unpack(archive, tmp_path)
    write_report(folder)
    told = json.loads((folder / "report.json").read_text())["verdict"]
    assert told["word"] == read_manifest(folder).verdict
    assert told["version"] == 1
    is_judged = told["decided"] == "with the run" and told["word"] != "NOT JUDGED"
    sentence = f"{OF_OTHER_RULES[0].upper()}{OF_OTHER_RULES[1:]}."
    assert told["by_rules"] == (sentence if is_judged else None)
    assert (sentence in (folder / "report.html").read_text("utf-8")) is is_judged
    assert said_by("check", folder)[0] == 0


def test_a_check_that_cannot_judge_a_run_says_so_in_its_last_line(tmp_path: Path) -> None:
    """Else an ACCEPT by other rules would read like one that was recomputed."""
    folder = make_run(tmp_path, 2.0)
    write_manifest(folder, replace(read_manifest(folder), rules=RULES + 1, verdict="ACCEPT"))
    code, said = said_by("check", folder)
    assert (code, "verdict not recomputed" in said.splitlines()[-1]) == (0, True)


# -- by the rules of this version ------------------------------------------------------------------


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {
        name: record(name, tmp_path_factory.mktemp(name)) for name in ("rejected", "not_judged")
    }


@pytest.fixture
def run_of(kept: dict[str, Path]) -> RunOf:
    """A copy of one of these runs."""
    return lambda name, out: Path(shutil.copytree(kept[name], out / kept[name].name))


def test_it_is_judged_again_to_the_last_figure(run_of: RunOf, tmp_path: Path) -> None:
    folder = run_of("rejected", tmp_path)
    manifest = read_manifest(folder)
    assert manifest.rules == RULES == 0
    assert judge_again(folder, manifest).rules_as_dicts() == manifest.verdict_rules
    code, said = said_by("check", folder)
    assert (code, "not recomputed" in said) == (0, False)


def test_a_verdict_that_was_changed_since_is_found(run_of: RunOf, tmp_path: Path) -> None:
    folder = run_of("rejected", tmp_path)
    manifest = replace(read_manifest(folder), verdict="ACCEPT")
    shutil.rmtree(folder / "figures")
    write_manifest(folder, manifest)
    assert check_verdict(folder, manifest).differing == [
        "verdict: was ACCEPT, its record gives REJECT"
    ]


def changed(folder: Path, change: Callable[[dict[str, object]], object]) -> list[str]:
    """Change each rule of a verdict, and return what is found."""
    manifest = read_manifest(folder)
    for rule in manifest.verdict_rules:
        change(rule)
    return check_verdict(folder, manifest).differing


def test_a_figure_of_a_verdict_that_was_changed_since_is_found(
    run_of: RunOf, tmp_path: Path
) -> None:
    folder = run_of("rejected", tmp_path)
    found = changed(folder, lambda rule: rule.update(limit_value=1e9, observed=0.5))
    assert "verdict, coverage" in {one.rpartition(" of ")[0] for one in found}
    assert {one.partition(": was ")[0].rpartition(", ")[2] for one in found} == {
        "limit_value",
        "observed",
    }
    last_bits = changed(folder, lambda rule: rule.update(observed=nearly(rule["observed"])))
    assert last_bits == []


def nearly(value: object) -> object:
    return value * (1 + 1e-12) if isinstance(value, float) else value


@pytest.mark.parametrize("name", ["name", "station", "port", "result", "limit_value", "observed"])
def test_a_rule_that_lacks_something_is_a_difference(
    run_of: RunOf, tmp_path: Path, name: str
) -> None:
    assert changed(run_of("rejected", tmp_path), lambda rule: rule.pop(name)) != []


def test_a_rule_that_is_there_twice_is_a_difference(run_of: RunOf, tmp_path: Path) -> None:
    """The page of a report would show both."""
    folder = run_of("rejected", tmp_path)
    manifest = read_manifest(folder)
    manifest.verdict_rules.insert(0, {**manifest.verdict_rules[0], "result": "fail"})
    assert check_verdict(folder, manifest).differing == [
        "verdict, record: was fail and pass, its record gives pass"
    ]


@pytest.mark.parametrize("word", ["ACCEPT", "ACCEPT WITH DEVIATIONS", "REJECT", "accept"])
def test_a_run_that_was_cut_off_has_no_such_verdict(
    run_of: RunOf, tmp_path: Path, word: str
) -> None:
    folder = run_of("rejected", tmp_path)
    manifest = replace(read_manifest(folder), exit_status="lost", verdict=word)
    assert check_verdict(folder, manifest).differing == [
        f"verdict: was {word}, but a run that was cut off is INCONCLUSIVE or NOT JUDGED"
    ]
    assert check_verdict(folder, replace(manifest, verdict="INCONCLUSIVE")).differing == []


def test_a_run_that_was_cut_off_is_not_judged_only_without_limits(
    run_of: RunOf, tmp_path: Path
) -> None:
    lost = {"exit_status": "lost", "verdict": "NOT JUDGED"}
    folder = run_of("rejected", tmp_path)
    assert check_verdict(folder, replace(read_manifest(folder), **lost)).differing == [
        "verdict: was NOT JUDGED, but its recipes have limits"
    ]
    folder = run_of("not_judged", tmp_path)
    assert check_verdict(folder, replace(read_manifest(folder), **lost)).differing == []


def test_a_recipe_that_this_version_does_not_take_is_no_difference(
    run_of: RunOf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = run_of("rejected", tmp_path)
    manifest = read_manifest(folder)

    def refuse(path: Path, *, links: bool) -> object:
        raise OSError(path)

    monkeypatch.setattr("jbclog.config.load_recipe.load_recipe", refuse)
    found = check_verdict(folder, manifest)
    assert found.differing == []
    assert found.notes == ["verdict: not recomputed: this version cannot read the recipe of jtse-1"]
    (copy,) = (folder / "recipes").iterdir()
    copy.write_text("changed")
    assert (
        check_verdict(folder, manifest).differing[0]
        == "verdict: was REJECT, its record gives INCONCLUSIVE"
    )
