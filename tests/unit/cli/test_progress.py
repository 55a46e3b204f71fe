"""The table that a person sees while a run goes on."""

from __future__ import annotations

import io
import re
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.cells import cell_len
from rich.console import Console

from jbclog.analysis.joints.evidence import NOTHING_RECORDED
from jbclog.app.run.options import Metadata
from jbclog.cli import progress, terminal
from jbclog.cli.options import Color
from jbclog.config.load_recipe import parse_recipe
from jbclog.core.clock import SystemClock, UtcOffset
from jbclog.core.goal import JOINTS, UNITS, Goal
from jbclog.core.rows import EventRow, NoJournal, Severity
from jbclog.core.serial_line import LineFormat
from jbclog.live.joint_counter import count
from jbclog.live.states import NOT_COUNTED, OF_TIPS_ONLY, Joints
from jbclog.protocol.commands.family import FAMILIES
from jbclog.session.run.context import SessionContext
from jbclog.session.run.state import PortState, ReadingCount
from jbclog.session.run.task import StationTask
from support.command import until
from support.records.live_rows import Soldering

RECIPE = parse_recipe('[recipe]\nname = "job"\nrevision = 1\nfamilies = ["dde"]\n')


def context(name: str = "dde-1", outcome: str = "running") -> SessionContext:
    """A station with two ports; the first is known, the second not."""
    order = StationTask(
        name, "nowhere", FAMILIES["dde"], LineFormat(), 1, None, RECIPE, "job.toml", FAMILIES, 0.0
    )
    found = SessionContext.of(order, NoJournal(), UtcOffset(SystemClock()))
    found.state.ports = {number: PortState(number) for number in (1, 2)}
    found.state.ports[1].temperatures_c, found.state.ports[1].status = (
        {"temperature_c": 349},
        (0, 0, 0, 0, 0),
    )
    found.state.ports[1].held["selected_temperature"] = 350
    found.state.connected, found.state.facts.outcome, found.state.facts.alarms = True, outcome, 2
    found.state.count_readings = lambda port: (
        ReadingCount(2000, 1999) if port == 1 else ReadingCount(0, 0)
    )
    return found


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Soldering]:
    made = Soldering(tmp_path)
    yield made
    made.abandon()


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> progress.Screen:
    """The live table of a run of a minute."""
    for module in (progress, terminal):
        monkeypatch.setattr(module, "is_terminal", lambda: True)
    shown = progress.observer(
        60.0, quiet=False, known=Metadata("A. Rossi", "88123", units=("SN-1",))
    )
    assert isinstance(shown, progress.Screen)
    return shown


def drawn(
    screen: progress.Screen, *contexts: SessionContext, width: int = 100, goals: Sequence[Goal] = ()
) -> list[str]:
    """The table's lines, as a terminal of this width shows them."""
    screen._printer.console = console = Console(file=io.StringIO(), width=width)
    console.print(screen._table(list(contexts), goals))
    return console.file.getvalue().splitlines()  # type: ignore[attr-defined]


def rows(screen: progress.Screen, *contexts: SessionContext) -> list[list[str]]:
    """The cells of its ports."""
    lines = drawn(screen, *contexts)
    return [
        [cell.strip() for cell in line.split("│")[1:-1]]
        for line in lines
        if "│" in line and "dde-" in line
    ]


def test_what_is_known_and_what_is_not(screen: progress.Screen) -> None:
    assert rows(screen, context()) == [
        # never rounded up to all of them
        ["dde-1", "1", "349 °C", "350 °C", "working", "2", "", "99.9 %", "1"],
        # alarms are the station's, shown once
        ["dde-1", "2", "unknown", "", "unknown", "", "", "unknown", ""],
    ]


def test_joints_so_far(screen: progress.Screen, recording: Soldering) -> None:
    """Counted in the record of the run, by a process that ends with the table."""
    recording.solder(500)
    screen.begun(recording.folder)
    # before the first count: not 0
    assert [row[6] for row in rows(screen, context())] == ["–", "–"]
    end = time.monotonic() + 240.0  # the counter is niced
    while (found := [row[6] for row in rows(screen, context())])[0] == "–":
        assert time.monotonic() < end
        time.sleep(0.1)
    assert found == [str(count(recording.folder).ports[0].count), "unknown"]
    assert drawn(screen, context())[-1] == f"joints unknown, dde-1 port 2: {NOTHING_RECORDED}"
    assert progress.joints_text(Joints(why=OF_TIPS_ONLY)) == ""
    process = screen._joints._counting._process if screen._joints is not None else None
    screen.close()
    assert process is not None
    assert until(lambda: process.returncode is not None)  # of low priority: it may take a while


def test_notes_below_the_table_say_why_joints_are_unknown_and_how_old_a_count_is() -> None:
    assert (
        progress.joints_notes(
            {("a", 1): Joints(3, 3, 4.0), ("b", 1): NOT_COUNTED, ("c", 1): Joints(why=OF_TIPS_ONLY)}
        )
        == []
    )
    found = {("a", port): Joints(None, 3, 40.0, "too short.") for port in (1, 2)} | {
        ("b", 1): Joints(3, 3, 40.2)
    }
    assert progress.joints_notes(found) == [
        "joints: counted 40 s ago",
        "joints unknown, a port 1, a port 2: too short.",
    ]
    many = {("a", port): Joints(why=f"reason {port}") for port in range(5)}
    assert progress.joints_notes(many)[3:] == [
        "joints of other ports are unknown for 2 more reasons; `jbclog watch` has them"
    ]


def test_units_named_at_the_start_stand_in_the_title_until_one_is_read(
    screen: progress.Screen,
) -> None:
    screen._units = [f"SN-{number}" for number in range(1, 6)]
    assert drawn(screen, context())[0].endswith(" · units SN-1, SN-2, SN-3 and 2 more")
    screen.happened(EventRow(0, "unit.begin", Severity.INFO, "", raw="SN-9"))
    assert drawn(screen, context())[0].endswith(" · unit SN-9")


def test_the_title_has_time_goals_order_and_the_unit_on_the_bench(screen: progress.Screen) -> None:
    def title(*goals: Goal) -> str:
        passed, _, rest = drawn(screen, context(), goals=goals)[0].strip().partition(" · ")
        assert re.fullmatch(r"\d+ s of 1:00, .* left", passed)
        return rest

    assert title() == "order 88123 · unit SN-1"
    for kind, unit in (("unit.begin", "SN-2"), ("unit.end", "SN-2")):
        screen.happened(EventRow(0, kind, Severity.INFO, "", raw=unit))
        assert title() == "order 88123" + (" · unit SN-2" if kind == "unit.begin" else "")
    ends = Goal(UNITS, 40, 3), Goal(JOINTS, 200, 17)
    assert title(*ends) == "3 of 40 units · 17 of 200 joints so far · order 88123"
    # not counted yet, which is not 0
    assert title(Goal(JOINTS, 200)) == "to 200 joints · order 88123"


@pytest.mark.parametrize(
    ("width", "gone"),
    [
        (200, set()),
        (91, set()),
        (84, {"lost"}),
        (76, {"lost", "joints"}),
        (70, {"lost", "joints", "set"}),
        (60, {"lost", "joints", "set", "coverage"}),
    ],
)
def test_a_narrow_terminal_shows_fewer_columns_and_cuts_none(
    screen: progress.Screen, width: int, gone: set[str]
) -> None:
    screen._joints = SimpleNamespace(
        look=lambda **_: {("dde-workplace-12", 1): Joints(12)}, not_counted=NOT_COUNTED
    )  # type: ignore[assignment]
    lines = drawn(screen, context("dde-workplace-12"), width=width)
    (heads,) = (line for line in lines if "station" in line)
    assert {column.name for column in progress.COLUMNS} - set(
        heads.replace("┃", " ").split()
    ) == gone
    assert "…" not in "".join(lines)
    assert lines[0].endswith("order 88123 · unit SN-1")  # above the table, however narrow that is
    assert any("dde-workplace-12" in line for line in lines)
    assert max(map(cell_len, lines)) <= width


@pytest.mark.parametrize(
    ("passed", "shown"),
    [
        (12.2, "12 s of 20 s, 8 s left"),
        (19.4, "19 s of 20 s, 1 s left"),
        (20.0, "20 s of 20 s, ending"),
        (22.0, "20 s of 20 s, ending"),
    ],
)
def test_more_than_all_of_a_duration_never_passes(passed: float, shown: str) -> None:
    assert terminal.span_of(passed, 20.0) == shown
    assert terminal.span_of(3725.0, None) == "1:02:05"


def test_an_omega_shows_its_states_in_its_own_words(screen: progress.Screen) -> None:
    omega, family = context(), FAMILIES["omega"]
    omega.state.family, omega.state.facts.alarms = family, 0
    omega.state.ports = {
        1: PortState(1, states={"solder_shortage": ("normal", 1.0), "preparing": ("ready", 1.0)})
    }
    assert rows(screen, omega) == [["dde-1", "1", "", "", "normal, ready", "", "", "99.9 %", "1"]]


@pytest.mark.parametrize("outcome", ["refused", "gone", "stopped", "failed", "completed"])
def test_a_station_that_has_ended_shows_how(screen: progress.Screen, outcome: str) -> None:
    assert rows(screen, context(outcome=outcome)) == [
        ["dde-1", "1, 2", "", "", outcome, "2", "", "", ""]
    ]


def test_a_station_that_is_away(screen: progress.Screen) -> None:
    away = context()
    away.state.connected = False
    assert [row[2:5:2] for row in rows(screen, away)] == [["unknown", "disconnected"]] * 2


TEXT = "dde-1: 20 Hz does not fit its serial link: 84.8 % of it in use, 95 % is the limit"


def test_events_are_broken_between_words(
    monkeypatch: pytest.MonkeyPatch, screen: progress.Screen, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the local time and its zone."""
    monkeypatch.setenv("TZ", "Asia/Kolkata")
    time.tzset()
    screen._printer = terminal.Printer(Color.ALWAYS)
    screen._printer.console.width = 50
    screen.happened(EventRow(0, "unit.begin", Severity.INFO, TEXT, "dde-1"))
    shown = capsys.readouterr().err.splitlines()
    # the station's name once, no word in two pieces
    assert " ".join(shown).split() == ["05:30:00", "IST", "info", *TEXT.split()]
    assert max(map(len, shown)) < 50
    assert len(shown) == 3
    monkeypatch.undo()
    time.tzset()


@pytest.mark.parametrize(
    ("color", "no_color"),
    [(Color.ALWAYS, ""), (Color.ALWAYS, "1"), (Color.NEVER, ""), (Color.AUTO, "")],
)
def test_events_have_the_colour_of_their_severity(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], color: Color, no_color: str
) -> None:
    """Where colours are asked for; stderr is no terminal here."""
    monkeypatch.setenv("NO_COLOR", no_color)
    monkeypatch.setenv("TERM", "xterm")
    shown = progress.Lines(terminal.Printer(color))
    for severity in Severity:
        shown.happened(EventRow(0, "unit.begin", severity, TEXT, "dde-1"))
    lines = capsys.readouterr().err.splitlines()
    codes = ["", "\x1b[33m", "\x1b[31m", "\x1b[1;31m"] if color is Color.ALWAYS else [""] * 4
    assert ["".join(re.findall(r"\x1b\[[0-9;]+m", line)[:1]) for line in lines] == codes
    assert all("00:00:00Z" in line for line in lines)


def test_lines_for_a_log_are_left_whole(capsys: pytest.CaptureFixture[str]) -> None:
    shown = progress.observer(None, quiet=True)
    shown.begun(Path("runs/x"))
    shown.happened(EventRow(0, "station.error", Severity.ERROR, "long " * 60, "dde-1"))
    assert len(capsys.readouterr().err.splitlines()) == 2


def test_a_tool_that_could_not_be_made_safe_is_told_when_it_is_safe_at_last(
    capsys: pytest.CaptureFixture[str],
) -> None:
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
    assert [line.partition("dde-1: ")[2] for line in told] == [
        "safety.not_safe of port 1",
        "safety.safe_state of port 1",
    ]
