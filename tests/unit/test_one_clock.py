"""The times of a run are by its own clock: a step of the host's clock moves none of them."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pandas as pd
import pytest

from support.invoked import invoked
from support.product import (
    ClockStep,
    HostClock,
    RunFilter,
    UsageError,
    append_annotation,
    check_run,
    error_events,
    find_runs,
    open_run,
    read_manifest,
    start_doubt,
    where_used,
    write_report,
)
from support.virtual.stepped_run import SECONDS, stepped_run

UNITS = {5.0: "SN-1", 35.0: "SN-2"}
STEP_AT = 30.0
DAY = 86_400.0
SINCE_1970 = 1_790_000_000.0
SIZES = [-20.0, 3600.0, -DAY]
Started = dict[float, Path]


@pytest.fixture(scope="module")
def stepped(tmp_path_factory: pytest.TempPathFactory) -> Started:
    """Size of the step at 30 s -> run; 0.0 without a step."""
    runs = {}
    for size in (0.0, *SIZES):
        home = tmp_path_factory.mktemp("stepped")
        runs[size] = stepped_run(home, {STEP_AT: size} if size else {}, UNITS)
    return runs


@pytest.fixture(scope="module")
def from_1970(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run on a board without a real-time clock, whose clock a time server corrects."""
    home = tmp_path_factory.mktemp("rtc")
    return stepped_run(home, {STEP_AT: SINCE_1970}, UNITS, start_utc=12.0)


@pytest.mark.parametrize("size", SIZES)
def test_a_run_ends_after_its_start_and_lasts_as_long_as_it_did(
    stepped: Started, size: float
) -> None:
    usual, run = (open_run(stepped[key]) for key in (0.0, size))
    assert run.duration is not None
    assert run.duration == usual.duration
    assert SECONDS <= run.duration.total_seconds() < SECONDS + 10


@pytest.mark.parametrize("size", SIZES)
def test_every_row_has_the_time_that_it_has_without_a_step(stepped: Started, size: float) -> None:
    usual, run = (open_run(stepped[key]) for key in (0.0, size))
    rows, expected = (one.samples().drop(columns="run") for one in (run, usual))
    pd.testing.assert_frame_equal(rows, expected)
    assert run.samples().groupby("port")["time"].is_monotonic_increasing.all()


@pytest.mark.parametrize("size", SIZES)
def test_joints_and_samples_belong_to_the_unit_on_the_bench(stepped: Started, size: float) -> None:
    usual, run = (open_run(stepped[key]) for key in (0.0, size))
    joints = run.each_joint()
    units = [joint.unit for joint in joints]
    assert units == [joint.unit for joint in usual.each_joint()]
    assert {"SN-1", "SN-2"} <= set(units)
    for joint in joints:
        begin_s = joint.start_s
        expected = None if begin_s < 5 else "SN-1" if begin_s < 35 else "SN-2"
        assert joint.unit == expected
    assert all(joint.stop - joint.start < pd.Timedelta(seconds=10) for joint in joints)
    samples = run.samples()
    assert run.unit_at(samples["time"]).equals(usual.unit_at(usual.samples()["time"]))
    same = [one.units().drop(columns="run") for one in (run, usual)]
    pd.testing.assert_frame_equal(*same)


@pytest.mark.parametrize("size", SIZES)
def test_the_manifest_and_an_event_give_the_step_by_both_clocks(
    stepped: Started, size: float
) -> None:
    run = open_run(stepped[size])
    (step,) = run.manifest.clock_steps or []
    assert (step.step_s, step.offset_s) == (size, size)
    events = run.events()
    (event,) = events[events["kind"] == "clock.step"].to_dict("records")
    assert pd.Timestamp(step.time) == event["time"]
    assert pd.Timestamp(event["raw"]) - event["time"] == pd.Timedelta(seconds=size)
    since = event["time"] - run.samples()["time"].min()
    assert since.total_seconds() == pytest.approx(STEP_AT, abs=2)
    assert check_run(run.folder) == []


def test_a_step_that_the_manifest_does_not_list_is_found(tmp_path: Path) -> None:
    run = stepped_run(tmp_path, {STEP_AT: -20.0}, UNITS)
    path = run / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["clock_steps"] = []
    path.write_text(json.dumps(manifest))
    assert "manifest.json: clock_steps: differ from those in the events" in map(str, check_run(run))


@pytest.mark.parametrize("size", SIZES)
def test_times_by_the_hosts_clock_are_given_on_request(stepped: Started, size: float) -> None:
    run = open_run(stepped[size])
    (step,) = run.manifest.clock_steps or []
    plain = run.samples("dde-1", 1)
    walls = run.samples("dde-1", 1, clock="wall")
    is_after = plain["time"] >= pd.Timestamp(step.time)
    shift = pd.to_timedelta(is_after * size, "s")
    assert (walls["time"] == plain["time"] + shift).all()
    assert walls.drop(columns="time").equals(plain.drop(columns="time"))
    begin, end = walls["time"].iloc[-20], walls["time"].iloc[-10]
    some = run.samples("dde-1", 1, begin, end, ["tick"], clock="wall")
    wanted = walls[(walls["time"] >= begin) & (walls["time"] < end)]["tick"]
    assert some["tick"].tolist() == wanted.tolist()
    assert some.columns.tolist() == ["tick"]


def test_a_run_without_a_step_has_the_same_times_by_both_clocks(stepped: Started) -> None:
    run = open_run(stepped[0.0])
    pd.testing.assert_frame_equal(run.samples(clock="wall"), run.samples())
    with pytest.raises(UsageError, match="must be 'run' or 'wall'"):
        run.samples(clock="host")


def test_a_start_in_1970_that_is_corrected_is_told_by_runs_check_and_report(
    from_1970: Path,
) -> None:
    run = open_run(from_1970)
    text = "The host's clock was wrong at the start and was set 20718 days ahead during the run."
    assert run.duration is not None
    assert SECONDS <= run.duration.total_seconds() < SECONDS + 10
    listed = invoked("runs", str(from_1970.parent))
    assert text in listed.stderr
    (line,) = invoked("runs", str(from_1970.parent), "--json").stdout.splitlines()
    assert text in json.loads(line)["clock_wrong"]
    checked = invoked("check", str(from_1970))
    assert checked.exit_code == 0
    assert text in checked.stdout
    assert "by the corrected clock it began at 2026-09-21 14:13 UTC" in checked.stdout
    write_report(from_1970)
    report = json.loads((from_1970 / "report.json").read_text())
    assert text in report["clock_wrong"]
    assert SECONDS <= report["duration_s"] < SECONDS + 10
    assert text in (from_1970 / "report.html").read_text().replace("&#39;", "'")
    walls = run.samples(clock="wall")["time"]
    assert walls.min() > pd.Timestamp("2026-09-21", tz="UTC"), "the correction holds from the start"


def test_a_start_in_1970_that_nobody_corrects_is_told(tmp_path: Path) -> None:
    run = stepped_run(tmp_path, {}, UNITS, start_utc=12.0)
    assert "before 2020: that clock was wrong" in invoked("check", str(run)).stdout


def test_the_correction_of_a_start_in_1970_need_not_be_the_first_step() -> None:
    started = "1970-01-01T00:00:10.000000Z"
    small = ClockStep("1970-01-01T00:00:20.000000Z", 2.0, 2.0)
    large = ClockStep("1970-01-01T00:00:30.000000Z", 1.79e9, 1.79e9 + 2.0)
    back = ClockStep("1970-01-01T00:00:40.000000Z", -1.0, 1.79e9 + 1.0)
    assert "is not known" in (start_doubt(started, [small]) or "")
    steps = [small, large, back]
    assert "it began at 2026-09-21 14:13 UTC" in (start_doubt(started, steps) or "")
    host = HostClock(steps, started)
    assert [host.corrected(second * 10**6) - second * 10**6 for second in (10, 25, 35, 45)] == [
        1_790_000_002_000_000,
        1_790_000_002_000_000,
        1_790_000_002_000_000,
        1_790_000_001_000_000,
    ]
    usual = "2026-09-21T14:13:20.000000Z"
    day = ClockStep(usual, 86_400.0, 86_400.0)
    assert start_doubt(usual, [day]) is None
    more = replace(day, step_s=-86_401.0, offset_s=-86_401.0)
    assert "was set 1 day back during the run" in (start_doubt(usual, [more]) or "")
    assert start_doubt(usual, [small, more]) is None, "only a first step shows a wrong start"


def test_a_usual_start_is_not_told(stepped: Started) -> None:
    for size in (0.0, -20.0, 3600.0):
        assert "clock was wrong" not in invoked("check", str(stepped[size])).stdout


def test_an_acknowledgement_has_its_time_by_the_runs_clock(tmp_path: Path) -> None:
    run = open_run(stepped_run(tmp_path, {STEP_AT: 3600.0}, UNITS))
    ended = datetime.fromisoformat(read_manifest(run.folder).stop or "")
    append_annotation(
        run.folder,
        who="A. Rossi",
        what="dde-1:1:low:B:1",
        why="seen",
        kind="alarm.acknowledged",
        utc_s=ended.timestamp() + 3600.0 + 5.0,
    )
    (given,) = run.alarm_findings().acknowledged.values()
    assert datetime.fromisoformat(given.time).timestamp() == pytest.approx(
        ended.timestamp() + 5.0, abs=0.01
    )


def test_runs_are_found_by_the_corrected_clock(from_1970: Path) -> None:
    """Their folders' names have the wrong start."""
    begin = datetime(2026, 9, 21, tzinfo=UTC)
    end = datetime(2026, 9, 22, tzinfo=UTC)
    wanted = (RunFilter(since=begin), RunFilter(until=end), RunFilter(ended_since=begin))
    others = (RunFilter(since=end), RunFilter(until=begin), RunFilter(ended_since=end))
    assert [len(list(find_runs(from_1970.parent, one))) for one in wanted] == [1, 1, 1]
    assert [len(list(find_runs(from_1970.parent, one))) for one in others] == [0, 0, 0]


def test_a_run_that_began_in_1970_is_suspect_after_a_failed_verification(from_1970: Path) -> None:
    out = from_1970.parent
    before, after = datetime(2026, 9, 20, tzinfo=UTC), datetime(2026, 9, 22, tzinfo=UTC)
    (suspect,) = where_used(out, "dde-1", since=before).runs
    assert suspect.folder == from_1970
    assert where_used(out, "dde-1", since=after).runs == []


def test_moments_are_converted_from_and_to_the_hosts_clock(
    stepped: Started, from_1970: Path
) -> None:
    run = open_run(stepped[-20.0])
    start = pd.Timestamp(run.manifest.start)
    assert run.host_time(start + pd.Timedelta("5s")) == start + pd.Timedelta("5s")
    assert run.host_time(start + pd.Timedelta("50s")) == start + pd.Timedelta("30s")
    assert run.run_time(start + pd.Timedelta("30s")) == start + pd.Timedelta("50s")
    assert run.run_time(start + pd.Timedelta("5s")) == start + pd.Timedelta("5s")
    ahead = open_run(stepped[3600.0])
    begin = pd.Timestamp(ahead.manifest.start)
    (step,) = ahead.manifest.clock_steps or []
    skipped = begin + pd.Timedelta("10min")
    assert ahead.run_time(skipped) == pd.Timestamp(step.time), "the host's clock never showed it"
    old = open_run(from_1970)
    began = pd.Timestamp(old.manifest.start)
    assert old.run_time(old.host_time(began)) == began
    assert old.run_time("2025-01-01") < began


def test_an_audit_counts_errors_by_the_hosts_clock(stepped: Started) -> None:
    """The station has an error at 45 s, an hour later by the host's clock."""
    run = open_run(stepped[3600.0])
    hours = [f"2026-09-21T{hour}:00:00+00:00" for hour in (14, 15, 16)]
    assert error_events(run, "dde-1", hours[0], hours[1]) == {}
    assert error_events(run, "dde-1", hours[1], hours[2]) == {"station.error": 1}
