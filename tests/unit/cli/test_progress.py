"""The table that a person sees while a run goes on."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from jbclog.cli import progress
from jbclog.config.load_recipe import parse_recipe
from jbclog.core.clock import SystemClock, UtcOffset
from jbclog.core.rows import EventRow, NoJournal, Severity
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.family import FAMILIES
from jbclog.session.run.context import PortState, SessionContext, StationTask

RECIPE = parse_recipe('[recipe]\nname = "job"\nrevision = 1\nfamilies = ["dde"]\n')


def context(name: str = "dde-1", outcome: str = "running") -> SessionContext:
    """A station with two ports; the first is known, the second not."""
    order = StationTask(name, "nowhere", FAMILIES["dde"], LineFormat(), 1, None, RECIPE, "job.toml", FAMILIES, 0.0)
    found = SessionContext(order, NoJournal(), UtcOffset(SystemClock()))
    found.ports = {number: PortState(number) for number in (1, 2)}
    found.ports[1].temperatures_c, found.ports[1].status = {"temperature_c": 349}, (0, 0, 0, 0, 0)
    found.ports[1].held["selected_temperature"] = 350
    found.connected, found.facts.outcome, found.facts.alarms = True, outcome, 2
    return found


def rows(monkeypatch: pytest.MonkeyPatch, *contexts: SessionContext) -> list[list[str]]:
    """The table's cells, as a terminal shows them."""
    monkeypatch.setattr(progress, "is_terminal", lambda: True)
    screen = progress.observer(60.0, quiet=False)
    assert isinstance(screen, progress.Screen)
    console = Console(file=io.StringIO(), width=100)
    console.print(screen._table(list(contexts)))
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    return [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines if "dde-" in line]


def test_what_is_known_and_what_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    assert rows(monkeypatch, context()) == [
        ["dde-1", "1", "349 °C", "350 °C", "working", "2", "connected"],
        ["dde-1", "2", "unknown", "", "unknown", "", "connected"],  # alarms are the station's, told once
    ]


def test_an_omega_shows_its_states_in_its_own_words(monkeypatch: pytest.MonkeyPatch) -> None:
    omega, family = context(), FAMILIES["omega"]
    omega.family, omega.facts.alarms = family, 0
    omega.ports = {1: PortState(1, states={"solder_shortage": ("normal", 1.0), "preparing": ("ready", 1.0)})}
    assert rows(monkeypatch, omega) == [["dde-1", "1", "", "", "normal, ready", "", "connected"]]


@pytest.mark.parametrize("outcome", ["refused", "gone", "stopped", "failed", "completed"])
def test_a_station_that_has_ended_shows_how(monkeypatch: pytest.MonkeyPatch, outcome: str) -> None:
    assert rows(monkeypatch, context(outcome=outcome)) == [["dde-1", "1, 2", "", "", "", "2", outcome]]


def test_a_station_that_is_away(monkeypatch: pytest.MonkeyPatch) -> None:
    away = context()
    away.connected = False
    assert [row[2:5:2] + row[6:] for row in rows(monkeypatch, away)] == [["unknown", "unknown", "disconnected"]] * 2


def test_events_are_broken_between_words(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", "50")
    text = "dde-1: 20 Hz does not fit its wire: 84.8 % in use with 1.00 ms of turnaround, 95 % is the limit"
    progress.Screen(None).happened(EventRow(0, "station.refused", Severity.ERROR, text, "dde-1"))
    told = capsys.readouterr().err.rstrip("\n")
    assert told.split() == ["00:00:00Z", "error", *text.split()]  # the station's name once, no word in two pieces
    assert max(map(len, told.split("\n"))) < 50
    assert len(told.split("\n")) == 3


def test_lines_for_a_log_are_left_whole(capsys: pytest.CaptureFixture[str]) -> None:
    shown = progress.observer(None, quiet=True)
    shown.begun(Path("runs/x"))
    shown.happened(EventRow(0, "station.error", Severity.ERROR, "long " * 60, "dde-1"))
    assert len(capsys.readouterr().err.splitlines()) == 2


def test_a_tool_that_could_not_be_made_safe_is_told_when_it_is_safe_at_last(capsys: pytest.CaptureFixture[str]) -> None:
    shown = progress.observer(None, quiet=True)
    for kind, severity, port in (
        ("safety.safe_state", Severity.INFO, 1),  # as a thousand times before
        ("safety.not_safe", Severity.CRITICAL, 1),
        ("safety.safe_state", Severity.INFO, 2),
        ("safety.safe_state", Severity.INFO, 1),
        ("safety.safe_state", Severity.INFO, 1),
    ):
        shown.happened(EventRow(0, kind, severity, f"{kind} of port {port}", "dde-1", port))
    told = capsys.readouterr().err.splitlines()
    assert [line.partition("dde-1: ")[2] for line in told] == ["safety.not_safe of port 1", "safety.safe_state of port 1"]
