"""What a report repeats of its record is compared leaf by leaf; what is computed is on a list."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from jbclog.analysis.run import open_run
from jbclog.record.annotations import append, vouch
from jbclog.report import agreement
from jbclog.report.agreement import differences
from jbclog.report.write import write_report
from support.invoked import invoked
from support.records.small_run import make_run

COMPUTED = {
    *("overview", "alarms", "units", "metrics", "paper_by", "drawn_by", "written"),
    *(
        f"recorded.{name}"
        for name in ("readings", "coverage_percent", "longest_gap_s", "late_p99_ms", "gaps")
    ),
    *("tip", "power", "states", "air", "alarms", "doubtful_alarms", "figures", "joints"),
}
"""As docs/explanation/record.md lists them; those of a port without its place."""
OF_PORT = "stations.[].ports.[]."


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty seconds of two stations with an alarm, annotated, with a report."""
    folder = make_run(tmp_path_factory.mktemp("runs"), seconds=20.0)
    append(
        folder,
        who="A. Rossi",
        what="SN-0012 was scrapped",
        why="cracked joint",
        utc_s=1_790_000_100.0,
    )
    write_report(folder)
    return folder


@pytest.fixture
def report(run: Path) -> Iterator[dict[str, Any]]:
    """What `report.json` says; the file is as before afterwards."""
    before = {name: (run / name).read_bytes() for name in ("report.json", "annotations.jsonl")}
    yield json.loads(before["report.json"])
    for name, content in before.items():
        (run / name).write_bytes(content)


def branches(value: Any, place: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
    """Each place with what holds it and its key, those that hold others, too."""
    keys = (
        value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    )
    for key in keys:
        here = (*place, "[]" if isinstance(value, list) else str(key))
        yield here, value, key
        yield from branches(value[key], here)


def is_computed(place: tuple[str, ...]) -> bool:
    parts = ".".join(place).removeprefix(OF_PORT).split(".")
    return parts[0] in COMPUTED or ".".join(parts[:2]) in COMPUTED


def test_each_leaf_that_is_not_computed_is_compared(
    run: Path, report: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = open_run(run)
    assert [*differences(opened, report)] == []
    known = agreement._expected(opened, report)
    unnoticed, tried = set[str](), 0
    for top in report:  # each alone: the others are as they were
        part = {top: report[top]}
        monkeypatch.setattr(agreement, "_expected", lambda *_, top=top: {top: known[top]})
        for place, holder, key in branches(part):
            before = holder[key]
            for other in ("other", None, 1 if before is True else 0 if before is False else -1):
                if other != before or isinstance(before, bool) != isinstance(other, bool):
                    holder[key], tried = other, tried + 1
                    if not any(differences(opened, part)) and not is_computed(place):
                        unnoticed.add(".".join(place))
            holder[key] = before
    assert (unnoticed, tried > 3000) == (set(), True)


def test_what_is_computed_is_on_the_list_of_the_documentation() -> None:
    text = (Path(__file__).parents[3] / "docs" / "explanation" / "record.md").read_text()
    listed = text.partition("\nComputed from the samples")[2].partition("\n\n")[0]
    names = {name.rpartition(".")[2] for name in COMPUTED} - {"paper_by", "drawn_by", "written"}
    assert {name for name in names if f"`{name}`" not in listed} == set()


CHANGES: dict[str, tuple[Callable[[Any], object], str]] = {
    "a reason": (
        lambda said: said["verdict"]["reasons"][0].update(text="All limits passed."),
        "verdict, reasons, entry 1, text: All",
    ),
    "number of rows": (
        lambda said: said["stations"][0]["ports"][0]["recorded"].update(rows=7),
        "recorded, rows: 7, the record",
    ),
    "how a tool was left": (
        lambda said: said["stations"][0]["ports"][0].update(left="verified?"),
        "left: verified?",
    ),
    "a tag": (
        lambda said: said["metadata"].update(colour="red"),
        "metadata, colour: red, the record gives nothing",
    ),
    "an event": (
        lambda said: said["events"][0].update(text="nothing"),
        "events, entry 1, text: nothing",
    ),
    "a setting": (
        lambda said: said["settings"][0].update(readback="1"),
        "readback: 1, the record gives",
    ),
    "an annotation left out": (lambda said: said["annotations"].clear(), "annotations: []"),
    "a key of its own": (
        lambda said: said.update(accepted="yes"),
        "accepted: yes, the record gives nothing",
    ),
    "another maker of this version": (lambda said: said.pop("jbclog"), "names no maker"),
    "no possible maker": (lambda said: said.update(jbclog="0.0.1"), "there was none before"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_check_names_what_was_changed_with_its_line(
    run: Path, report: dict[str, Any], what: str
) -> None:
    change, said = CHANGES[what]
    vouched_anew(run, report, change)
    ended = invoked("check", run)
    assert ended.exit_code == 1
    assert any(
        line.startswith("report.json: ") and said in line for line in ended.stdout.splitlines()
    ), ended.stdout


def test_a_report_that_claims_another_maker_is_not_covered(
    run: Path, report: dict[str, Any]
) -> None:
    vouched_anew(run, report, lambda said: said.update(jbclog="99.0.0"))
    ended = invoked("check", run)
    assert ended.exit_code == 0
    assert "not covered: report.json: made by jbclog 99.0.0 with rules" in ended.stdout
    assert "no differences in what is covered; 1 file not covered" in ended.stdout


def vouched_anew(run: Path, report: dict[str, Any], change: Callable[[Any], object]) -> None:
    change(report)
    (run / "report.json").write_text(json.dumps(report))
    lines = (run / "annotations.jsonl").read_bytes().splitlines(keepends=True)
    (run / "annotations.jsonl").write_bytes(lines[0])
    vouch(run, hashlib.sha256((run / "report.json").read_bytes()).hexdigest())
