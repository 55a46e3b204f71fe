"""Runs that earlier versions of the rules judged: no later jbclog calls them changed
(tests/data/verdicts).
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.analysis import rule_versions as versions
from jbclog.analysis.rejudge import check_verdict, judge_again
from jbclog.analysis.rule_versions import Version
from jbclog.analysis.verdict import RULES
from jbclog.record.manifest import read_manifest, write_manifest
from jbclog.report.write import write_report
from support.invoked import invoked
from support.records.small_run import make_run
from support.records.verdict_corpus import HOME, judged, unpack

ARCHIVES = sorted(HOME.glob("*/*.tar.xz"))
OF_RULES_1 = HOME / "rules-1"


def name_of(archive: Path) -> str:
    return f"{archive.parent.name}-{archive.name.split('.')[0]}"


def is_reported(archive: Path) -> bool:
    """Of rules 2 three show how a report is compared; the campaign has them all."""
    return archive.parent == OF_RULES_1 or archive.name.split(".")[0] in (
        "accepted",
        "deviations",
        "rejected",
    )


REPORTED = [
    path if is_reported(path) else pytest.param(path, marks=pytest.mark.campaign)
    for path in ARCHIVES
]
every_run = pytest.mark.parametrize("archive", ARCHIVES, ids=name_of)


def run_of(name: str, out: Path) -> Path:
    return unpack(OF_RULES_1 / f"{name}.tar.xz", out)


def said_by(*words: object) -> tuple[int, str]:
    result = invoked(*words)
    return result.exit_code, result.output


def test_every_verdict_is_among_them() -> None:
    noted = json.loads((OF_RULES_1 / "noted.json").read_text())
    verdicts = {one["verdict"] for one in noted.values()}
    assert verdicts == {"ACCEPT", "ACCEPT WITH DEVIATIONS", "REJECT", "INCONCLUSIVE", "NOT JUDGED"}
    assert {path.name.split(".")[0] for path in OF_RULES_1.glob("*.tar.xz")} == set(noted)


@every_run
def test_it_says_what_it_said_and_nothing_is_called_changed(archive: Path, tmp_path: Path) -> None:
    folder = unpack(archive, tmp_path)
    noted = json.loads((archive.parent / "noted.json").read_text())[archive.name.split(".")[0]]
    assert judged(folder) == noted
    code, said = said_by("check", folder)
    *before, last = said.splitlines()
    assert (code, last.startswith(f"{folder}: no differences")) == (0, True)
    apart = [line for line in before if not line.startswith("not covered: report.json: ")]
    earlier = f"judged by {archive.parent.name.replace('-', ' ')}, not recomputable here"
    assert all(line.startswith("verdict, ") and line.endswith(earlier) for line in apart)


@pytest.mark.parametrize("archive", REPORTED, ids=name_of)
def test_its_report_is_not_called_changed_and_a_new_one_says_what_it_said(
    archive: Path, tmp_path: Path
) -> None:
    folder = unpack(archive, tmp_path)
    write_report(folder)
    told = json.loads((folder / "report.json").read_text())
    assert told["verdict"]["word"] == read_manifest(folder).verdict
    assert said_by("check", folder)[0] == 0


@pytest.mark.parametrize(
    "archive", sorted(OF_RULES_1.glob("*.tar.xz")), ids=lambda path: path.name.split(".")[0]
)
def test_it_is_judged_by_its_own_rules_again_to_the_last_one(archive: Path, tmp_path: Path) -> None:
    folder = unpack(archive, tmp_path)
    manifest = read_manifest(folder)
    if manifest.exit_status != "lost":
        gone = versions.not_kept(1)
        again = [
            without_text(rule)
            for rule in judge_again(folder, manifest).rules_as_dicts()
            if rule["name"] not in gone
        ]
        assert again == [
            without_text(rule) for rule in manifest.verdict_rules if rule["name"] not in gone
        ]


def without_text(rule: dict[str, object]) -> dict[str, object]:
    """A rule's figures and result: its sentence may be worded anew."""
    return {name: value for name, value in rule.items() if name != "text"}


def test_a_verdict_that_was_changed_since_is_found(tmp_path: Path) -> None:
    folder = run_of("rejected", tmp_path)
    manifest = replace(read_manifest(folder), verdict="ACCEPT")
    shutil.rmtree(folder / "figures")
    write_manifest(folder, manifest)
    assert check_verdict(folder, manifest).differing == [
        "verdict: was ACCEPT, its record gives REJECT"
    ]


def forged(folder: Path, change: Callable[[dict[str, object]], object]) -> list[str]:
    """Change each rule of a verdict, and return what is found."""
    manifest = read_manifest(folder)
    for rule in manifest.verdict_rules:
        change(rule)
    return check_verdict(folder, manifest).differing


def test_a_figure_of_a_verdict_that_was_changed_since_is_found(tmp_path: Path) -> None:
    folder = run_of("rejected", tmp_path)
    found = forged(folder, lambda rule: rule.update(limit=1e9, observed=0.5))
    assert "verdict, coverage" in {one.rpartition(" of ")[0] for one in found}
    assert {one.partition(": was ")[0].rpartition(", ")[2] for one in found} == {
        "limit",
        "observed",
    }
    last_bits = forged(folder, lambda rule: rule.update(observed=nearly(rule["observed"])))
    assert last_bits == []


def nearly(value: object) -> object:
    return value * (1 + 1e-12) if isinstance(value, float) else value


@pytest.mark.parametrize("name", ["name", "station", "port", "result", "limit", "observed"])
def test_a_rule_that_lacks_something_is_a_difference(tmp_path: Path, name: str) -> None:
    assert forged(run_of("rejected", tmp_path), lambda rule: rule.pop(name)) != []


def test_a_rule_that_is_there_twice_is_a_difference(tmp_path: Path) -> None:
    """The page of a report would show both."""
    folder = run_of("rejected", tmp_path)
    manifest = read_manifest(folder)
    manifest.verdict_rules.insert(0, {**manifest.verdict_rules[0], "result": "fail"})
    assert check_verdict(folder, manifest).differing == [
        "verdict, record: was fail and pass, its record gives pass"
    ]


@pytest.mark.parametrize("word", ["ACCEPT", "ACCEPT WITH DEVIATIONS", "REJECT", "accept"])
def test_a_run_that_was_cut_off_has_no_such_verdict(tmp_path: Path, word: str) -> None:
    folder = run_of("rejected", tmp_path)
    manifest = replace(read_manifest(folder), exit_status="lost", verdict=word)
    assert check_verdict(folder, manifest).differing == [
        f"verdict: was {word}, but a run that was cut off is INCONCLUSIVE or NOT JUDGED"
    ]
    assert check_verdict(folder, replace(manifest, verdict="INCONCLUSIVE")).differing == []


def test_a_run_that_was_cut_off_is_not_judged_only_without_limits(tmp_path: Path) -> None:
    lost = {"exit_status": "lost", "verdict": "NOT JUDGED"}
    folder = run_of("rejected", tmp_path)
    assert check_verdict(folder, replace(read_manifest(folder), **lost)).differing == [
        "verdict: was NOT JUDGED, but its recipes have limits"
    ]
    folder = run_of("not_judged", tmp_path)
    assert check_verdict(folder, replace(read_manifest(folder), **lost)).differing == []


def test_what_cannot_be_judged_as_it_was_is_said_and_is_no_difference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rules 3 find joints otherwise than rules 1 and do not keep the way of before; a later version
    may do so with any rule.
    """
    folder = run_of("deviations", tmp_path)
    manifest = read_manifest(folder)
    for rule in manifest.verdict_rules:
        if rule["name"] in ("recovery_p95", "idle_error"):
            rule["result"] = "missing"  # by the earlier method
    manifest.verdict = "INCONCLUSIVE"
    joints = [
        f"verdict, {name}: judged by rules 1, not recomputable here"
        for name in ("joints_against_counter", "recovery_p95")
    ]
    found = check_verdict(folder, manifest)
    assert {one.split(" of ")[0] for one in found.differing} == {"verdict, idle_error"}
    assert found.notes == joints
    later = Version(
        RULES + 1, "idle is found otherwise", frozenset({"idle_error"}), keeps_earlier=False
    )
    monkeypatch.setattr(versions, "VERSIONS", (*versions.VERSIONS, later))
    found = check_verdict(folder, manifest)
    assert found.differing == []
    assert found.notes == ["verdict, idle_error: judged by rules 1, not recomputable here", *joints]


def test_a_run_of_rules_that_are_not_known_here_is_no_difference(tmp_path: Path) -> None:
    folder = run_of("accepted", tmp_path)
    manifest = replace(read_manifest(folder), rules=RULES + 1, verdict="REJECT")
    found = check_verdict(folder, manifest)
    assert found.differing == []
    assert found.notes == [
        f"verdict: judged by rules {RULES + 1}, not recomputable here: this jbclog knows rules 1 to"
        f" {RULES}"
    ]


def test_a_check_that_cannot_judge_a_run_says_so_in_its_last_line(tmp_path: Path) -> None:
    """Else an ACCEPT of rules that are not known would read like one that was recomputed."""
    folder = make_run(tmp_path, 2.0)
    write_manifest(folder, replace(read_manifest(folder), rules=RULES + 1, verdict="ACCEPT"))
    code, said = said_by("check", folder)
    assert (code, "verdict not recomputed in full" in said.splitlines()[-1]) == (0, True)


def test_a_recipe_that_this_jbclog_does_not_take_any_more_is_no_difference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = run_of("accepted", tmp_path)
    manifest = read_manifest(folder)

    def refuse(path: Path, *, links: bool) -> object:
        raise OSError(path)

    monkeypatch.setattr("jbclog.config.load_recipe.load_recipe", refuse)
    found = check_verdict(folder, manifest)
    assert found.differing == []
    assert found.notes == [
        "verdict: judged by rules 1, not recomputable here: this jbclog cannot read the recipe of"
        " nae-1"
    ]
    (copy,) = (folder / "recipes").iterdir()
    copy.write_text("changed")
    assert (
        check_verdict(folder, manifest).differing[0]
        == "verdict: was ACCEPT, its record gives INCONCLUSIVE"
    )
