"""Texts of the live view: a value that is not known never reads like one that is."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

from jbclog.app.watch import words
from jbclog.core.rows import EventRow, Severity
from jbclog.live import Condition, Coverage, Joints, NumberedEvent, Phase, PortState, Reading, Trace
from jbclog.live.states import NOT_COUNTED, RUN_ENDED
from support.records import live_states


@pytest.mark.parametrize(
    ("reading", "text"),
    [
        (Reading(350, 0.3, None, is_stale=False), "350 °C"),
        (Reading(350, 12.0, "timeout", is_stale=False), "unknown (timeout; last 350 °C, 12 s ago)"),
        (Reading(350, 12.0, None, is_stale=True), "unknown (stale; last 350 °C, 12 s ago)"),
        (Reading(350, None, None, is_stale=True), "unknown (stale; last 350 °C, unknown age)"),
        (Reading(350, None, RUN_ENDED, is_stale=True), "unknown (run ended; last 350 °C)"),
        (Reading(None, None, "no_tool", is_stale=False), "unknown (no_tool)"),
        (Reading(), "unknown (not read yet)"),
        (Reading(None, None, "not supported", is_stale=False), "not supported"),
    ],
)
def test_a_reading(reading: Reading, text: str) -> None:
    assert words.reading_text(reading, "°C") == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.04, "0.0 s"),
        (9.9, "9.9 s"),
        (10, "10 s"),
        (119, "119 s"),
        (120, "2 min"),
        (7200, "2 h"),
    ],
)
def test_an_age(seconds: float, text: str) -> None:
    assert words.age_text(seconds) == text


@pytest.mark.parametrize(
    ("coverage", "text"),
    [
        (Coverage(), "coverage unknown"),
        (Coverage(1000, 1000, is_whole=True), "coverage 100.0 % of 1000"),
        # never rounded up to all of them
        (Coverage(100_000, 99_999, is_whole=True), "coverage 99.9 % of 100000"),
        (Coverage(100, 50), "coverage 50.0 % of 100, still counting"),
    ],
)
def test_coverage(coverage: Coverage, text: str) -> None:
    assert words.coverage_text(coverage) == text


def test_a_sparkline_is_blank_where_nothing_was_read() -> None:
    line = words.sparkline(live_states.trace(gap=range(300, 400)), 60)
    assert len(line) == 60
    assert line.index(" ") == 30
    assert line.count(" ") == pytest.approx(10, abs=1)
    assert words.sparkline(Trace(), 10).strip() == ""


def test_noise_does_not_look_like_a_change() -> None:
    seconds = tuple(float(number - 59) for number in range(60))
    flat = Trace(seconds, tuple(350.0 + number % 2 for number in range(60)), (None,) * 60)
    assert set(words.sparkline(flat, 60)[1:]) == {"▄", "▅"}


def test_slow_readings_leave_no_gaps() -> None:
    slow = Trace((-50.0, -30.0, -10.0, 0.0), (340.0, 350.0, 360.0, 350.0), (None,) * 4)
    line = words.sparkline(slow, 60)
    assert line[:10].strip() == ""
    assert " " not in line[10:]


def test_a_plot_has_its_range_and_its_time() -> None:
    lines = words.plot(live_states.trace(20), 60, 8)
    assert len(lines) == 9
    assert (lines[0][:8], lines[7][:8]) == (" 350 °C ", " 330 °C ")
    assert lines[8].endswith("now")
    assert {len(line) for line in lines} == {60}
    assert words.plot(Trace(), 60, 8) == ["no reading in the last minute"]


def heated(lasted_s: int) -> PortState:
    """A tip that was heated up in the run's first ten seconds."""
    seconds = tuple(float(one) for one in range(lasted_s + 1))
    means = tuple(2.5 + 5 * one for one in range(lasted_s // 5))
    hour = Trace(means, tuple(min(300 + 5 * one, 350.0) for one in means), (None,) * len(means))
    minute = seconds[-61:]
    trace = Trace(minute, tuple(min(300 + 5 * one, 350.0) for one in minute), (None,) * len(minute))
    return live_states.port(1, Condition.NORMAL, live_states.known(350), trace=trace, hour=hour)


def test_an_hour_ends_with_what_is_now() -> None:
    assert words.hour_plot(heated(20), 68, 8) == [
        "too short yet for an hour's plot; `h` shows the last minute"
    ]
    lines = words.hour_plot(heated(150), 68, 8)
    assert (lines[0][:8], lines[0][-1]) == (" 350 °C ", "█")
    assert lines[8].strip().startswith("-60 min")
    cooled = replace(
        heated(150),
        trace=replace(
            heated(150).trace, temperature_c=(*heated(150).trace.temperature_c[:-1], 200.0)
        ),
    )
    lines = words.hour_plot(cooled, 68, 8)
    assert (lines[7][:8], lines[7][-1]) == (" 200 °C ", "▁")


def test_foreign_text_is_one_plain_line() -> None:
    run = live_states.run()
    assert all(
        "\x1b" not in line and "\n" not in line for line in words.queue_lines((live_states.QUEUE,))
    )
    assert all(
        "\x1b" not in line and "\n" not in line for line in map(words.event_line, run.events)
    )
    assert "\x1b" not in "".join(line for port in run.ports for line in words.port_lines(port, 30))


def test_of_an_ended_run_no_row_is_awaited() -> None:
    port = live_states.run().ports[0]
    ended = Reading(350, None, RUN_ENDED, is_stale=True)
    over = replace(port, row_age_s=None, readings={**port.readings, "temperature_c": ended})
    assert words.row_text(over) == "no more rows"
    assert words.row_text(replace(port, row_age_s=None)) == "row of unknown age"
    assert words.row_text(replace(port, row_age_s=3.0)) == "row 3.0 s ago"


def test_a_status_that_is_not_known_has_its_name() -> None:
    """Beside the power, "unknown" alone would not say of what."""
    status = Reading("working", 3.0, "timeout", is_stale=False)
    assert words.status_text(Reading("working", 0.2, None, is_stale=False)) == "working"
    assert words.status_text(status) == "status unknown (timeout; last working, 3.0 s ago)"


def test_a_tile_names_its_port_once_and_counts_alarms_that_are_over() -> None:
    port = live_states.port(
        2,
        Condition.ALARM,
        live_states.known(392),
        alarms=("Port 2: high-temperature alarm.",),
        alarms_so_far=3,
    )
    lines = words.port_lines(port, 30)
    assert lines[-1] == "! high-temperature alarm."
    assert lines[4] == "row 0.3 s ago · joints 128 · alarms 3"


@pytest.mark.parametrize(
    ("zone", "text"), [("UTC", "UTC"), ("CET-1", "CET (UTC+0100)"), ("EST5", "EST (UTC-0500)")]
)
def test_a_zone_is_named_once(zone: str, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as changed:
        changed.setenv("TZ", zone)
        time.tzset()
        assert words.zone_text() == text
    time.tzset()


def test_an_event_names_its_port_once() -> None:
    event = EventRow(
        0, "alarm.low", Severity.WARNING, "dde-2: Port 2: low-temperature alarm.", "dde-2", 2
    )
    assert words.event_line(NumberedEvent(1, event)).endswith(
        "  dde-2 port 2: low-temperature alarm."
    )
    of_station = EventRow(0, "link.lost", Severity.WARNING, "dde-2: Port 2: all are lost.", "dde-2")
    assert words.event_line(NumberedEvent(1, of_station)).endswith("  dde-2: Port 2: all are lost.")


def test_the_line_of_a_run_has_all_units() -> None:
    run = replace(live_states.run(), unit=None, units=("U-1", "U-2"))
    assert "order 88123 · units U-1, U-2" in words.run_line(run)


def test_joints_before_the_first_count_are_a_dash() -> None:
    assert words.joints_text(NOT_COUNTED) == "joints –"
    assert words.joints_text(Joints(why="too short", found=2)) == "joints not known (2 found)"
    assert words.joints_text(Joints(3, 3, 20.0)) == "joints 3 (20 s ago)"


@pytest.mark.parametrize(
    ("phase", "expected"),
    [
        (Phase.RECORDING, "ALARM"),
        (Phase.CRASHED, "CRASHED"),
        (Phase.DELAYED, "DELAYED"),
        (Phase.FINALIZED, "ALARM"),
    ],
)
def test_a_title_says_when_nothing_is_known(phase: Phase, expected: str) -> None:
    assert words.title(live_states.run(phase=phase)) == expected
    assert words.title(None) == "NO RUN YET"
