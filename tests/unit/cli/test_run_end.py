"""The end of a run on the terminal: at most a line a station and three for the verdict, and what to
do next.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.run.run_record import Result
from jbclog.cli.run import _print
from jbclog.core.outcome import Exit, findings
from jbclog.core.rows import StationFacts
from jbclog.core.states import SafetyResult, StationOutcome
from jbclog.record.manifest import Manifest

FOLDER = Path("runs/x")
RULES: list[dict[str, object]] = [
    {
        "name": "coverage",
        "station": "a",
        "port": 1,
        "result": "fail",
        "text": "Port 1: Coverage 90 % (90 of 100), limit 99.5 %.",
    },
    {
        "name": "idle_error",
        "station": "a",
        "port": 1,
        "result": "missing",
        "text": "Port 1: The tip never rested.",
    },
]


def result(
    *stations: StationFacts, verdict: str = "REJECT", cut_short: Exit | None = None
) -> Result:
    manifest = Manifest(
        "x", state="sealed", verdict=verdict, stations=list(stations), verdict_rules=RULES
    )
    found = findings(stations, verdict=verdict, record=None, cut_short=cut_short)
    code = found[0].code if found else Exit.FINE
    return Result(FOLDER, code, found, manifest)


def station(name: str, **facts: object) -> StationFacts:
    safe = {1: SafetyResult.VERIFIED.value}
    return StationFacts(
        name,
        "nowhere",
        "dde",
        outcome=StationOutcome.COMPLETED,
        touched=[1],
        safe_state=safe,
        **facts,
    )  # type: ignore[arg-type]


def printed(capsys: pytest.CaptureFixture[str], of: Result, page: Path | None = None) -> list[str]:
    _print(of, page)
    out, err = capsys.readouterr()
    assert out == f"{FOLDER}\n"
    return err.splitlines()


def test_an_accepted_run_needs_three_lines(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, result(station("a"), verdict="ACCEPT")) == [
        "verdict: ACCEPT; exit code 0",
        "1 tool is in its safe state, as read back",
        "Next: jbclog report runs/x",
    ]


def test_findings_of_a_station_are_one_line_and_the_verdict_has_its_first_reason(
    capsys: pytest.CaptureFixture[str],
) -> None:
    stations = [
        station("a", alarms=2, unconfirmed_alarms=1, settings_changed=1),
        station("b", alarms=1),
        station("c"),
    ]
    assert printed(capsys, result(*stations)) == [
        (
            "exit 1: a: 1 setting found changed during the run; 2 alarms; 1 alarm flag not"
            " confirmed by a temperature"
        ),
        "exit 1: b: 1 alarm",
        (
            "verdict: REJECT; exit code 1. fail: a port 1: Coverage 90 % (90 of 100), limit 99.5 %."
            " (coverage), and 1 more"
        ),
        "3 tools are in their safe state, as read back",
        "Next: jbclog report runs/x",
    ]


def test_a_worse_finding_stands_for_itself_and_a_written_report_is_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = printed(
        capsys, result(station("a"), cut_short=Exit.INTERRUPTED), FOLDER / "report.html"
    )
    assert lines == [
        "exit 130: the run was cut short by a signal before its stated end; the record is closed",
        "verdict: REJECT; exit code 130",
        "1 tool is in its safe state, as read back",
        "report: runs/x/report.html",
    ]
