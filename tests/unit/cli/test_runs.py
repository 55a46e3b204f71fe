"""`jbclog runs` as it is typed: a table, JSON lines, what is wrong with a folder on stderr."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import Result

from jbclog.analysis.verdict import Verdict
from jbclog.cli.runs import STATES, VERDICTS
from jbclog.core.rows import StationFacts
from jbclog.record import find_runs
from jbclog.record.check import check
from jbclog.record.manifest import (
    NAME,
    LineFile,
    Manifest,
    Metadata,
    RecipeFile,
    Unit,
    write_manifest,
)
from support.invoked import invoked

RUN = "20261121T013000Z-bench-3-k7qd"
FULL = Manifest(
    RUN,
    state="sealed",
    exit_status="success",
    exit_code=0,
    verdict="ACCEPT",
    start="2026-11-21T01:30:00.500000Z",
    line=LineFile("bench-3", "line.toml", "ab"),
    recipes=[RecipeFile("recipes/a.toml", "cd", "sn100c-tht", 7)],
    metadata=Metadata("陳", "88123", None, ["SN-0"], {"shift": "1"}, ["W-7"], [], ["T1"]),
    units=[Unit("SN-1", "2026-11-21T01:31:00.000000Z")],
    stations=[StationFacts("ale-1", "url", "ale")],
)


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs"
    (folder / RUN).mkdir(parents=True)
    write_manifest(folder / RUN, FULL)
    return folder


def told(*arguments: str) -> Result:
    return invoked("runs", *arguments)


def test_a_run_is_a_row_with_its_folder_last(runs: Path) -> None:
    shown = told()
    assert (shown.exit_code, shown.stderr) == (0, "")
    assert (
        shown.stdout
        == "start UTC         line     recipe        operator  order  product  units    verdict "
        " state  run\n2026-11-21 01:30  bench-3  sn100c-tht@7  陳        88123  -        SN-0"
        f" +1  ACCEPT   ended  runs/{RUN}\n"
    )


def test_the_unit_that_was_sought_is_the_one_that_is_shown(runs: Path) -> None:
    assert "SN-1 +1" in told("--unit", "SN-1").stdout


def test_json_is_a_line_a_run_with_everything_by_which_it_is_found(runs: Path) -> None:
    (line,) = told(
        "--json", "--wire-lot", "W-7", "--tip", "T1", "--tag", "shift=1"
    ).stdout.splitlines()
    one = json.loads(line)
    assert (one["run"], one["folder"]) == (RUN, f"runs/{RUN}")
    assert (one["units"], one["tags"], one["recipes"]) == (
        ["SN-0", "SN-1"],
        {"shift": "1"},
        ["sn100c-tht@7"],
    )


@pytest.mark.parametrize(
    ("arguments", "sought"),
    [
        (["--order", "1"], ""),
        (["--since", "2026-11-22"], " from 2026-11-22 00:00 UTC on"),
        (["--until", "2026-11-20"], " before 2026-11-21 00:00 UTC"),
        (["--tag", "a=1"], ""),
    ],
)
def test_where_none_fits_that_is_said(runs: Path, arguments: list[str], sought: str) -> None:
    shown = told(*arguments)
    expected = (0, "", f"runs: no run matches{sought}\n")
    assert (shown.exit_code, shown.stdout, shown.stderr) == expected


def test_a_day_that_ends_the_search_is_in_it(runs: Path) -> None:
    assert RUN in told("--since", "2026-11-21", "--until", "2026-11-21").stdout


def test_damaged_folders_are_told_on_stderr_and_do_not_hide_the_others(runs: Path) -> None:
    broken = runs / RUN.replace("k7qd", "aaaa")
    broken.mkdir()
    (broken / NAME).write_text("{")
    crashed = runs / RUN.replace("k7qd", "bbbb")
    crashed.mkdir()
    write_manifest(crashed, replace(FULL, state="open", exit_status=None, verdict=None))
    shown = told("--order", "88123")
    assert shown.exit_code == 0
    assert [row.split()[-2] for row in shown.stdout.splitlines()[1:]] == ["crashed", "ended"]
    assert shown.stderr.startswith(f"runs/{broken.name}: its manifest cannot be read")


@pytest.mark.parametrize(
    ("exit_status", "verdict", "state"),
    [
        ("success", "REJECT", "ended"),
        ("success", "ACCEPT", "ended"),
        ("aborted", "ACCEPT WITH DEVIATIONS", "cut short"),
        ("failed", "ACCEPT WITH DEVIATIONS", "ended with error"),
        ("lost", "INCONCLUSIVE", "recovered"),
        (None, None, "sealed"),
    ],
)
def test_the_state_says_how_a_run_ended_and_nothing_of_its_verdict(
    runs: Path, exit_status: str | None, verdict: str | None, state: str
) -> None:
    write_manifest(runs / RUN, replace(FULL, exit_status=exit_status, verdict=verdict))
    row = told().stdout.splitlines()[1]
    assert row.endswith(
        f"{verdict or '-'}{' ' * (len('verdict') - len(verdict or '-'))}  {state}  runs/{RUN}"
    )
    (line,) = told("--json").stdout.splitlines()
    one = json.loads(line)
    # as in the manifest
    assert (one["shown_state"], one["exit_status"], one["state"]) == (state, exit_status, "sealed")
    if exit_status is not None:
        assert len(told("--state", state).stdout.splitlines()) == 2
    assert "no run matches" in told("--state", "crashed").stderr


def test_the_states_are_those_of_runs() -> None:
    assert STATES == find_runs.STATES


def test_no_state_is_a_word_of_success_or_failure() -> None:
    assert not any(
        word in state
        for state in STATES
        for word in ("success", "fail", "accept", "reject", "good", "ok")
    )


def test_what_people_said_steers_no_terminal(runs: Path) -> None:
    write_manifest(runs / RUN, replace(FULL, metadata=Metadata("\x1b[2J\nX" + "Y" * 100)))
    shown = told()
    assert "\x1b" not in shown.stdout
    assert len(shown.stdout.splitlines()) == 2
    assert "Y" * 100 in shown.stdout  # not cut where no terminal is


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["nowhere"], "nowhere: no such folder"),
        (["--since", "yesterday"], "--since yesterday: give a day such as 2026-11-21"),
        (["--until", "9999-12-31"], "--until 9999-12-31: give a day"),
        (
            ["--verdict", "rejected"],
            "--verdict REJECTED: must be one of ACCEPT, ACCEPT WITH DEVIATIONS, REJECT",
        ),
        (["--state", "done"], "--state done: must be one of running, crashed"),
        (["--tag", "shift"], "--tag shift: must be NAME=VALUE"),
    ],
)
def test_wrong_usage(runs: Path, arguments: list[str], why: str) -> None:
    shown = told(*arguments)
    assert shown.exit_code == 2
    assert why in shown.stderr


def test_verdicts_are_those_of_the_judge() -> None:
    assert set(VERDICTS) == {str(one) for one in Verdict}


# -- annotate --unit -------------------------------------------------------------------------------


def test_a_serial_told_late_is_found_and_the_record_is_as_it_was(runs: Path) -> None:
    said = invoked(
        "annotate",
        f"runs/{RUN}",
        "--unit",
        " SN-7 ",
        "--by",
        "A. Rossi",
        "--reason",
        "the reader was off",
    )
    assert said.exit_code == 0, said.output
    assert "SN-7 +2" in told("--unit", "SN-7").stdout
    shown = invoked("annotate", f"runs/{RUN}").stdout
    assert "A. Rossi: unit SN-7 (the reader was off)" in shown
    assert not any("annotations" in str(finding) for finding in check(runs / RUN))


@pytest.mark.parametrize(
    "arguments",
    [
        ["--unit", "SN-7"],
        ["TEXT", "--unit", "SN-7", "--by", "A", "--reason", "B"],
        ["--unit", "a\x1bb", "--by", "A", "--reason", "B"],
    ],
)
def test_a_serial_told_late_wants_who_and_why(runs: Path, arguments: list[str]) -> None:
    assert invoked("annotate", f"runs/{RUN}", *arguments).exit_code == 2
    assert not (runs / RUN / "annotations.jsonl").exists()


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (["TEXT"], "--by WHO and --reason TEXT are required"),
        (["TEXT", "--by", "A"], "--reason TEXT is required"),
        (["--unit", "SN-7", "--by", " ", "--reason", "B"], "--by WHO is required"),
        ([" ", "--by", "A", "--reason", "B"], "TEXT is empty"),
        (["--by", "A"], "--by and --reason are of a note: give its TEXT, or --unit SERIAL"),
    ],
)
def test_a_note_names_all_that_it_lacks(runs: Path, given: list[str], why: str) -> None:
    refused = invoked("annotate", f"runs/{RUN}", *given)
    assert refused.exit_code == 2
    assert " ".join(refused.stderr.split()) == f"error: annotate: {why}; nothing was added"
    assert not (runs / RUN / "annotations.jsonl").exists()


@pytest.mark.parametrize(
    ("verb", "options", "when"),
    [
        ("annotate", ["--by WHO", "--reason TEXT"], "with TEXT or --unit"),
        ("alarms", ["--by WHO", "--reason TEXT"], "with ack"),
        ("maintenance", ["-s, --station NAME", "--task NAME"], "with done"),
    ],
)
def test_help_marks_what_a_part_of_a_command_needs(
    verb: str, options: list[str], when: str
) -> None:
    shown = invoked(verb, "--help", terminal_width=200).stdout
    for option in options:
        (line,) = (line for line in shown.splitlines() if line.strip().startswith(option))
        assert line.endswith(f"[required {when}]")
