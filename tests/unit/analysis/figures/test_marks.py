"""Alarms, errors and limits on the figure's time axis."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jbclog.analysis.figures.curves import Span
from jbclog.analysis.figures.marks import happenings, limits_of, marks_of
from jbclog.analysis.run import open_run
from jbclog.core.rows import EventRow, SettingRow, Severity
from support.records.sealed_run import alarm, limit, micros, samples, seal, station, table


def event(
    second: float, kind: str, port: int | None = 1, name: str | None = "dde-1", **more: object
) -> EventRow:
    return EventRow(micros(second), kind, Severity.ERROR, f"{kind}.", name, port, **more)  # type: ignore[arg-type]


def marks(tmp_path: Path, *events: EventRow, port: int = 1) -> list[tuple[str, Span]]:
    run = open_run(seal(tmp_path, [station(rows=600)], table(samples(600)), events))
    return [
        (mark.kind, mark.span)
        for mark in marks_of(happenings(run.events(), micros(0)), "dde-1", port)
    ]


def test_an_alarm_lies_between_its_earliest_and_its_latest_moment(tmp_path: Path) -> None:
    assert marks(tmp_path, alarm(26)) == [("alarm", Span(24, 26, "high"))]


def test_what_does_not_count_is_not_marked_as_an_alarm(tmp_path: Path) -> None:
    silent = alarm(26)._replace(severity=Severity.INFO)
    doubtful = event(30, "alarm.unconfirmed", earliest=micros(28), raw="low")
    assert marks(tmp_path, silent, doubtful) == [("unconfirmed", Span(28, 30, "low"))]


def test_an_error_lasts_until_the_station_says_that_it_is_gone(tmp_path: Path) -> None:
    told = [
        event(10, "port.error", code=9),
        event(12, "port.error", port=2, code=1),
        event(20, "port.ok", code=0),
    ]
    assert marks(tmp_path, *told) == [("error", Span(10, 20, "port error 9"))]


def test_an_error_lasts_until_another_one_takes_its_place(tmp_path: Path) -> None:
    told = [
        event(10, "port.error", code=9),
        event(14, "port.error", code=7),
        event(20, "port.error", code=0),
        event(25, "port.error", code=9),
    ]
    assert marks(tmp_path, *told) == [
        ("error", Span(10, 14, "port error 9")),
        ("error", Span(14, 20, "port error 7")),
        ("error", Span(25, 25, "port error 9")),
    ]


def test_an_error_of_the_station_is_marked_at_each_of_its_ports_and_at_no_others(
    tmp_path: Path,
) -> None:
    told = [
        event(10, "station.error", port=None, code=1),
        event(15, "station.ok", port=None, code=0),
    ]
    other = event(11, "station.error", port=None, name="dde-2", code=1)
    assert marks(tmp_path, *told, other, port=2) == [("error", Span(10, 15, "station error 1"))]


def test_after_a_step_of_the_wall_clock_marks_stay_on_the_grid(tmp_path: Path) -> None:
    step = EventRow(
        micros(10 + 3600), "clock.step", Severity.WARNING, "The clock was stepped.", value=3600.0
    )
    late = alarm(26)._replace(time=micros(26 + 3600), earliest=micros(24 + 3600))
    assert marks(tmp_path, step, late) == [("alarm", Span(24, 26, "high"))]


def limits(
    tmp_path: Path, *rows: SettingRow
) -> list[tuple[str, tuple[float, ...], tuple[float, ...]]]:
    run = open_run(seal(tmp_path, [station(rows=600)], table(samples(600)), settings=rows))
    return [
        (one.side, one.seconds, one.celsius)
        for one in limits_of(run.settings(), micros(0)).get(("dde-1", 1), [])
    ]


def test_a_limit_holds_from_when_it_was_read_back(tmp_path: Path) -> None:
    found = limits(
        tmp_path, limit("high", "380"), limit("high", "400", 30), limit("high", "370", port=2)
    )
    assert found == [("high", (-1.0, 30.0), (380.0, 400.0))]


def test_a_limit_that_is_off_or_whose_alarm_is_off_is_not_drawn(tmp_path: Path) -> None:
    delay = limit("high", "off")._replace(setting="alarm_high_delay")
    assert limits(tmp_path, limit("high", "380"), delay, limit("low", "off")) == []


def test_a_limit_beyond_all_numbers_is_not_drawn(tmp_path: Path) -> None:
    """As of a forged part: no axis takes it."""
    assert limits(tmp_path, limit("high", "1e400"), limit("low", "-inf")) == []


def test_a_limit_that_was_switched_off_ends(tmp_path: Path) -> None:
    found = limits(tmp_path, limit("low", "300"), limit("low", "off", 30))
    assert found[0][2][0] == 300
    assert np.isnan(found[0][2][1])
