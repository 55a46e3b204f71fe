"""What a call on a run can choose: times, kinds of events, the setpoint in force, station and port;
each mistake is refused with what would be right.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import date, time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import jbclog
from jbclog.analysis.port_data import SETTING_HOLDS_S
from jbclog.analysis.run_tables import utc
from jbclog.core.errors import UsageError
from support.records import small_run
from support.records.sealed_run import lose, samples, seal, station, table

PER_READING = 50  # rows from one reading of the setpoint to the next


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> jbclog.Run:
    return jbclog.open_run(small_run.make_run(tmp_path_factory.mktemp("runs"), 40.0))


# -- times -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "moment",
    [
        "20:22",
        "20:22+01:00",
        "now",
        "today",
        "",
        "2026-11",
        "21/11/2026",
        "10000-01-01",
        "2026-13-01",
        "2026-11-21 20:22 CET",
        time(20, 22),
        pd.NaT,
        pd.Timestamp.min,
        np.datetime64("NaT"),
        1_790_000_000,
    ],
    ids=str,
)
def test_what_is_no_time_with_a_date_is_refused_with_how_to_write_one(
    run: jbclog.Run, moment: str
) -> None:
    calls: list[Callable[[], object]] = [
        lambda: run.samples(start=moment),
        lambda: run.samples(stop=moment, clock="wall"),
        lambda: run.events(start=moment),
        lambda: run.stream(stop=moment),
        lambda: run.host_time(moment),
        lambda: jbclog.open_runs(run.folder.parent, since=moment),
    ]
    if isinstance(moment, str):
        calls.append(lambda: run.unit_at([moment]))
    for call in calls:
        with pytest.raises(
            UsageError, match=r"no time with a date; write 2026-11-21, 2026-11-21T2"
        ):
            call()


@pytest.mark.parametrize(
    ("moment", "expected"),
    [
        ("2026-11-21", "2026-11-21T00:00Z"),
        (date(2026, 11, 21), "2026-11-21T00:00Z"),
        ("2026-11-21T20:22+01:00", "2026-11-21T19:22Z"),
        ("2026-11-21 20:22:00.123456Z", "2026-11-21T20:22:00.123456Z"),
        (np.datetime64("2026-11-21T20:22:00.123456789"), "2026-11-21T20:22:00.123456Z"),
        (pd.Timestamp("2026-11-21T20:22", tz="Europe/Rome"), "2026-11-21T19:22Z"),
    ],
)
def test_a_date_and_a_zone_are_understood(moment: str, expected: str) -> None:
    assert utc(moment) == pd.Timestamp(expected)


@pytest.mark.parametrize("far", ["0001-01-01", "9999-12-31"])
def test_the_ends_of_the_calendar_select_all_or_nothing(run: jbclog.Run, far: str) -> None:
    rows = len(run.samples())
    is_past = far.startswith("0")
    assert len(run.samples(start=far)) == (rows if is_past else 0)
    assert len(run.samples(stop=far)) == (0 if is_past else rows)


# -- events ----------------------------------------------------------------------------------------


def test_events_of_a_kind(run: jbclog.Run) -> None:
    events = run.events()
    assert list(run.events(kind="link.lost")["station"]) == ["ale-1"]
    several = run.events(kind="link.*")
    assert list(several["kind"]) == ["link.lost", "link.back"]
    assert list(several.index) == [0, 1]
    assert len(run.events(kind="*")) == len(events)
    assert len(run.events(kind="tool.changed")) == 0  # a kind that this run has not
    assert len(run.events("dde-1", 2, kind="port.*")) == 2
    assert len(run.events("dde-1", 1, kind="port.*")) == 0


@pytest.mark.parametrize("kind", ["alarm.hihg", "alarm", "alarms.*", ""])
def test_a_kind_that_no_event_has_is_refused_with_those_that_there_are(
    run: jbclog.Run, kind: str
) -> None:
    with pytest.raises(UsageError, match=r"events have no kind .*They have .*alarm\.high, .*tool"):
        run.events(kind=kind)


# -- station and port ------------------------------------------------------------------------------

OF_A_PORT = ("settings", "counters", "joints", "metrics", "events", "samples")


@pytest.mark.parametrize("method", OF_A_PORT)
def test_rows_of_one_port(run: jbclog.Run, method: str) -> None:
    rows = getattr(run, method)("dde-1", 2)
    every = getattr(run, method)()
    own = every[(every["station"] == "dde-1") & (every["port"] == 2)]
    assert len(rows) > 0
    pd.testing.assert_frame_equal(rows, own.reset_index(drop=True))


@pytest.mark.parametrize("method", OF_A_PORT)
def test_an_unknown_port_is_refused_with_those_that_there_are(run: jbclog.Run, method: str) -> None:
    with pytest.raises(UsageError, match="dde-1 has no port 3; it has 1, 2"):
        getattr(run, method)("dde-1", 3)


# -- the setpoint in force -------------------------------------------------------------------------


def test_the_setpoint_in_force_is_the_last_one_read_from_the_same_port(run: jbclog.Run) -> None:
    read, filled = run.samples(), run.samples(setpoint="in force")
    rest = [name for name in read.columns if name != "setpoint_c"]
    pd.testing.assert_frame_equal(filled[rest], read[rest])
    for (name, port), own in read.groupby(["station", "port"]):
        expected = own["setpoint_c"].ffill()
        here = filled.loc[own.index, "setpoint_c"]
        pd.testing.assert_series_equal(here, expected)
        assert here.notna().sum() > 10 * own["setpoint_c"].notna().sum(), (name, port)
    assert read["setpoint_c"].isna().sum() > 1000
    assert filled["setpoint_c"].dtype == read["setpoint_c"].dtype


@pytest.mark.parametrize("clock", ["run", "wall"])
def test_it_is_the_same_in_a_part_of_the_run(run: jbclog.Run, clock: str) -> None:
    whole = run.samples("dde-1", 2, setpoint="in force")
    start, stop = whole["time"].iloc[PER_READING + 7], whole["time"].iloc[2 * PER_READING - 3]
    columns = ["setpoint_c", "tick"]
    part = run.samples("dde-1", 2, start, stop, columns, clock=clock, setpoint="in force")
    own = whole[(whole["time"] >= start) & (whole["time"] < stop)]
    pd.testing.assert_frame_equal(part, own[columns].reset_index(drop=True))
    assert part["setpoint_c"].notna().all()
    assert run.samples("dde-1", 2, start, stop, columns, clock=clock)["setpoint_c"].isna().all()


def test_it_ends_with_the_time_for_which_the_analysis_believes_it(tmp_path: Path) -> None:
    columns = samples(600)
    lose(columns, slice(101, 500))
    folder = seal(tmp_path, [station(rows=600)], table(columns))
    filled = jbclog.open_run(folder).samples(setpoint="in force")["setpoint_c"]
    last = 100 + round(10 * SETTING_HOLDS_S)
    assert filled[:last].notna().all()
    assert filled[last + 1 : 500].isna().all()
    assert filled[500:].notna().all()


@pytest.mark.parametrize(
    ("word", "value", "match"),
    [
        ("setpoint", "filled", "setpoint 'filled': must be 'as read' or 'in force'"),
        ("clock", "host", "clock 'host': must be 'run' or 'wall'"),
    ],
)
def test_an_unknown_word_is_refused_with_those_that_there_are(
    run: jbclog.Run, word: str, value: str, match: str
) -> None:
    with pytest.raises(UsageError, match=match):
        run.samples(**{word: value})
