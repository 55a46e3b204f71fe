"""What a follower knows of a run that is recorded by the real store: from any moment on, and never
more than there is.
"""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jbclog.core.clock import VirtualClock
from jbclog.core.errors import RecordError
from jbclog.core.rows import EventRow, Severity
from jbclog.live import Condition, Follower, Phase, RunState, follow
from jbclog.live.follower import current_run
from jbclog.live.record_follower import RecordFollower
from jbclog.live.sample_history import HOUR_S, Means
from jbclog.record import run_journal
from jbclog.record.folder import create_run
from jbclog.record.manifest import Manifest, write_manifest
from jbclog.record.recover import recover
from jbclog.record.seal import seal_journal
from jbclog.record.segments import Disk, segments
from support import program
from support.records import live_rows
from support.records.few_rows import vanish
from support.records.live_rows import NAME, PERIOD_S, Recording

WAIT_S = 60.0


class StandingClock(VirtualClock):
    """The clock of recorder and follower: a reading grows old when a test says so, not while the
    machine is busy. `stepped_s`: by how much the follower's wall clock alone was set;
    `of_recorder_s`: that of the recorder.
    """

    def __init__(self) -> None:
        super().__init__(utc=time.time())
        self.stepped_s = self.of_recorder_s = 0.0

    def utc(self) -> float:
        return super().utc() + self.stepped_s

    def recorder_s(self) -> float:
        return super().utc() + self.of_recorder_s

    def advance(self, seconds: float) -> None:
        self.advance_to(self.monotonic() + seconds)


@pytest.fixture
def clock() -> Iterator[StandingClock]:
    """Of all recorders of this process, and of the followers that are given it."""
    made = StandingClock()
    of_recorder = SimpleNamespace(
        monotonic=made.monotonic,
        time=made.recorder_s,
        time_ns=lambda: round(made.recorder_s() * 1e9),
    )
    with pytest.MonkeyPatch.context() as changed:
        changed.setattr(run_journal, "time", of_recorder)
        changed.setattr(live_rows, "now_us", lambda: round(made.recorder_s() * 1e6))
        yield made


@pytest.fixture
def recording(tmp_path: Path, clock: StandingClock) -> Iterator[Recording]:
    made = Recording(tmp_path, began_us=round(clock.recorder_s() * 1e6))
    yield made
    made.abandon()


@pytest.fixture
def follower(recording: Recording, clock: StandingClock) -> Iterator[Follower]:
    with Follower(recording.folder, clock) as made:
        yield made


def polled(follower: Follower) -> RunState:
    state = follower.poll()
    assert state is not None
    return state


def whole(follower: Follower) -> RunState:
    """The run when all of its rows were read."""
    end = time.monotonic() + WAIT_S
    while not (state := polled(follower)).is_whole:
        assert time.monotonic() < end
    return state


def stop_writing(recording: Recording) -> None:
    """End the recorder's thread, as where the disk hangs: the lock is held, and no mark comes."""
    recording.commit()
    recording.store._ending = True
    recording.store._thread.join()


# -- a moment --------------------------------------------------------------------------------------


def test_a_run_as_it_is_recorded(
    recording: Recording, follower: Follower, clock: StandingClock
) -> None:
    recording.rows(30)
    recording.rows(1, temperature_c=347, power_permille=250)
    recording.event("unit.begin", "unit SN-1", station=None, raw="SN-1")
    recording.setting("temperature_select_c", "350")
    recording.counter("work_h", 12.5)
    recording.commit()
    clock.advance(1.5)
    run = whole(follower)
    assert (run.phase, run.line, run.order, run.operator, run.unit) == (
        Phase.RECORDING,
        "bench",
        "88123",
        "A. Rossi",
        "SN-1",
    )
    (station,) = run.stations
    assert (station.name, station.outcome, station.rate_hz) == (NAME, "running", 10.0)
    assert [(one.name, one.value) for one in station.settings] == [("temperature_select_c", "350")]
    assert [(one.name, one.value) for one in station.counters] == [("work_h", 12.5)]
    assert [port.port for port in run.ports] == [1, 2]
    port = run.ports[0]
    assert port.condition is Condition.NORMAL
    assert (port.temperature.value, port.setpoint.value, port.power.value, port.status.value) == (
        347,
        350,
        250,
        "working",
    )
    assert port.temperature.is_known
    assert port.temperature.age_s == pytest.approx(1.5, abs=0.01)
    assert (port.coverage.due, port.coverage.obtained, port.coverage.is_whole) == (31, 31, True)
    assert port.trace.temperature_c == (350,) * 30 + (347,)
    assert port.trace.seconds[-3:] == pytest.approx((2.8, 2.9, 3.0))
    assert port.trace.last_s == pytest.approx(3.0)
    assert [one.event.kind for one in run.events] == ["unit.begin"]


def test_units_named_at_the_start_hold_until_one_is_read(
    recording: Recording, follower: Follower
) -> None:
    recording.manifest.metadata = replace(recording.manifest.metadata, units=["SN-1", "SN-2"])
    write_manifest(recording.folder, recording.manifest)
    recording.rows(1)
    recording.commit()
    assert (polled(follower).unit, polled(follower).units) == (None, ("SN-1", "SN-2"))
    for kind, units in (("unit.begin", ("SN-3",)), ("unit.end", ())):
        recording.event(kind, "", station=None, raw="SN-3")
        recording.commit()
        run = polled(follower)
        assert (run.unit, run.units) == (units[0] if units else None, units)


def test_between_two_commits_no_trace_is_made_anew(
    recording: Recording, follower: Follower
) -> None:
    """Two of three looks find nothing new; 64 traces made at each of them took most of a follower's
    time.
    """
    recording.rows(5)
    recording.commit()
    first = polled(follower).ports[0].trace
    assert polled(follower).ports[0].trace is first
    recording.rows(1)
    recording.commit()
    assert len(polled(follower).ports[0].trace.seconds) == len(first.seconds) + 1


def test_the_last_hour_is_known_whenever_following_began(recording: Recording) -> None:
    recording.rows(50, temperature_c=300, power_permille=100)
    recording.rows(25, temperature_c=400, power_permille=200)
    recording.rows(
        25,
        temperature_c=None,
        power_permille=None,
        quality="timeout",
        reasons="temperature_c=timeout",
    )
    recording.commit()
    with Follower(recording.folder) as early:
        polled(early)
        for _ in range(3):
            recording.rows(
                50,
                temperature_c=None,
                power_permille=None,
                quality="timeout",
                reasons="temperature_c=timeout",
            )
            recording.commit()
            recording.seal_part()
        recording.rows(51, temperature_c=310, power_permille=50)
        recording.commit()
        expected = ((300.0, 400.0, None, None, None, 310.0), (100.0, 200.0, None, None, None, 50.0))
        for follower in (early, Follower(recording.folder)):
            hour = whole(follower).ports[0].hour
            assert hour.seconds == (2.5, 7.5, 12.5, 17.5, 22.5, 27.5)
            assert (hour.temperature_c, hour.power_permille) == expected
            follower.close()


def test_an_hour_and_no_more() -> None:
    means = Means()
    for second in range(0, 2 * round(HOUR_S), 5):
        means.add(second // 5, np.array([350.0, 1, 100.0, 1]))
    means.add(3, np.array([1.0, 1, 1.0, 1]))  # an older row that is read late
    trace = means.trace()
    assert len(trace.seconds) == HOUR_S / 5 - 1
    assert set(trace.temperature_c) == {350.0}
    assert len(means._sums) <= 2 * HOUR_S / 5
    assert means._sums[3].tolist() == [350.0, 1, 100.0, 1]


def test_a_reading_that_failed_is_not_known(recording: Recording, follower: Follower) -> None:
    recording.rows(5)
    lost = {
        "temperature_c": None,
        "quality": "timeout",
        "reasons": "temperature_c=timeout;power_permille=timeout",
    }
    recording.rows(1, **lost, power_permille=None)
    recording.commit()
    port = whole(follower).ports[0]
    assert port.condition is Condition.NOT_KNOWN
    assert (port.temperature.value, port.temperature.why, port.temperature.is_known) == (
        350,
        "timeout",
        False,
    )
    assert (port.setpoint.value, port.setpoint.is_known) == (350, True)
    assert (port.coverage.due, port.coverage.obtained) == (6, 5)
    assert port.trace.temperature_c[-1] is None
    recording.rows(1)
    recording.commit()
    assert polled(follower).ports[0].condition is Condition.NORMAL


def test_an_old_reading_is_stale(recording: Recording, follower: Follower) -> None:
    """The recorder goes on to commit, and one of two ports has no rows any more."""
    recording.rows(5)
    recording.commit()
    assert [port.condition for port in polled(follower).ports] == [Condition.NORMAL] * 2
    first = recording.ports
    recording.ports = (1,)
    for _ in range(round(3 / PERIOD_S)):
        recording.store.sample(recording.row(1, recording.began_us))
        recording.tick += 1
    recording.rows(1)
    recording.commit()
    recording.ports = first
    one, two = polled(follower).ports
    assert (one.condition, two.condition) == (Condition.NORMAL, Condition.STALE)
    assert two.temperature.value == 350
    assert not two.temperature.is_known
    assert two.temperature.age_s == pytest.approx(3.1, abs=0.01)


LOST = {
    "temperature_c": None,
    "power_permille": None,
    "quality": "timeout",
    "reasons": "temperature_c=timeout;power_permille=timeout",
}


@pytest.mark.parametrize(
    ("failed", "expected"),
    [(1, Condition.NOT_KNOWN), (2, Condition.NOT_KNOWN), (3, Condition.STALE)],
)
def test_readings_that_fail_are_stale_after_two_periods(
    recording: Recording, follower: Follower, failed: int, expected: Condition
) -> None:
    """By the rows themselves: whatever the time from a commit to the look at it."""
    recording.rows(5)
    recording.rows(failed, **LOST)
    recording.commit()
    one, two = polled(follower).ports
    assert (one.condition, two.condition) == (expected, expected)
    assert (one.temperature.why, one.temperature.is_known) == ("timeout", False)


def test_a_station_that_is_unplugged_is_stale_in_the_update_that_shows_it(
    recording: Recording, follower: Follower
) -> None:
    recording.rows(5)
    recording.commit()
    assert polled(follower).ports[0].condition is Condition.NORMAL
    recording.event("link.lost", "The station cannot be reached.")
    recording.commit()
    port = polled(follower).ports[0]
    assert port.condition is Condition.STALE
    assert not any(reading.is_known for reading in port.readings.values())
    recording.rows(1, **LOST)
    recording.commit()
    assert polled(follower).ports[0].condition is Condition.STALE
    recording.event("link.back", "The station is reached again.")
    recording.rows(1)
    recording.commit()
    assert polled(follower).ports[0].condition is Condition.NORMAL


@pytest.mark.parametrize(("behind", "expected"), [(2, Condition.NORMAL), (3, Condition.STALE)])
def test_a_port_without_the_rows_of_the_other_is_stale(
    recording: Recording, follower: Follower, behind: int, expected: Condition
) -> None:
    recording.rows(5)
    recording.ports = (1,)
    recording.rows(behind)
    recording.ports = (1, 2)
    recording.commit()
    one, two = polled(follower).ports
    assert (one.condition, two.condition) == (Condition.NORMAL, expected)


def test_without_a_commit_nothing_looks_well(
    recording: Recording, follower: Follower, clock: StandingClock
) -> None:
    recording.rows(5)
    recording.commit()
    assert polled(follower).phase is Phase.RECORDING
    stop_writing(recording)
    polled(follower)
    clock.advance(10.0)
    run = polled(follower)
    assert run.phase is Phase.DELAYED
    assert run.commit_age_s == pytest.approx(10, abs=0.01)
    assert [port.condition for port in run.ports] == [Condition.STALE] * 2
    assert not any(reading.is_known for port in run.ports for reading in port.readings.values())


def test_a_clock_that_is_set_back_makes_nothing_look_fresh(
    recording: Recording, follower: Follower, clock: StandingClock
) -> None:
    recording.store.sample(recording.row(1, recording.began_us + 3_600_000_000))  # an hour ahead
    recording.commit()
    port = polled(follower).ports[0]
    assert (port.temperature.value, port.temperature.age_s, port.temperature.is_known) == (
        350,
        None,
        False,
    )
    assert port.condition is Condition.STALE


@pytest.mark.parametrize("stepped_s", [-20.0, 3600.0, -86_400.0])
def test_after_a_step_of_the_recorders_clock_ages_are_by_the_runs_clock(
    recording: Recording, follower: Follower, clock: StandingClock, stepped_s: float
) -> None:
    recording.rows(5)
    recording.commit()
    polled(follower)
    now_us = round(clock.recorder_s() * 1e6)
    step = EventRow(now_us, "clock.step", Severity.WARNING, "", value=stepped_s, raw="then")
    recording.store.event(step)
    recording.store.sample(recording.row(1, now_us + 500_000))
    clock.of_recorder_s = clock.stepped_s = stepped_s
    clock.advance(1.0)
    recording.commit()
    port = polled(follower).ports[0]
    assert port.temperature.is_known
    assert port.temperature.age_s == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("stepped_s", [-3600.0, 3600.0])
def test_a_clock_of_the_follower_that_is_set_changes_no_age(
    recording: Recording, follower: Follower, clock: StandingClock, stepped_s: float
) -> None:
    recording.rows(5)
    recording.commit()
    polled(follower)
    clock.stepped_s = stepped_s
    clock.advance(1.0)
    recording.rows(1)
    recording.commit()
    port = polled(follower).ports[0]
    assert port.temperature.is_known
    assert port.temperature.age_s == pytest.approx(0.0, abs=0.01)


def test_alarms_and_problems_hold_until_their_end(recording: Recording, follower: Follower) -> None:
    recording.rows(3)
    recording.event("alarm.high", "above 380 °C", 1)
    recording.event("link.lost", "cable unplugged")
    recording.commit()
    one, two = whole(follower).ports
    assert (one.condition, one.alarms, two.alarms) == (Condition.ALARM, ("above 380 °C",), ())
    assert (two.condition, two.problems) == (Condition.STALE, ("cable unplugged",))
    recording.event("alarm.high.ended", "back", 1)
    recording.event("link.back", "back")
    recording.rows(1)
    recording.commit()
    assert [port.condition for port in polled(follower).ports] == [Condition.NORMAL] * 2


def test_lost_alarm_flags_are_a_problem_until_they_are_read(
    recording: Recording, follower: Follower, clock: StandingClock
) -> None:
    recording.rows(1, alarm_high=False, alarm_low=False)
    recording.event("alarm.unknown", "lost", 1)
    recording.rows(1)
    recording.commit()
    assert [port.condition for port in polled(follower).ports] == [
        Condition.ATTENTION,
        Condition.NORMAL,
    ]
    clock.advance(PERIOD_S)
    recording.rows(1, alarm_high=False, alarm_low=False)
    recording.commit()
    assert [port.condition for port in polled(follower).ports] == [Condition.NORMAL] * 2


def test_alarms_are_counted_when_they_are_over(recording: Recording, follower: Follower) -> None:
    recording.rows(1)
    for kind in ("alarm.high", "alarm.high.ended", "alarm.low", "alarm.low.ended", "alarm.high"):
        recording.event(kind, "above", 1)
    recording.commit()
    first, second = polled(follower).ports
    assert (first.alarms, first.alarms_so_far) == (("above",), 3)
    assert (second.alarms, second.alarms_so_far) == ((), 0)


def test_a_temperature_whose_setpoint_is_not_known_is_not_normal(
    recording: Recording, follower: Follower
) -> None:
    """As just after an outage: the temperature is read at once, the setpoint seconds later."""
    recording.facts.signals.append("setpoint_c")
    recording.store.facts(recording.facts)
    recording.rows(1)
    recording.commit()
    assert polled(follower).ports[0].condition is Condition.NORMAL
    recording.rows(1, setpoint_c=None, reasons="setpoint_c=disconnected")
    recording.rows(1, setpoint_c=None)
    recording.commit()
    port = polled(follower).ports[0]
    assert (port.condition, port.problems) == (
        Condition.ATTENTION,
        ("The set temperature is not known: disconnected.",),
    )
    recording.rows(1)
    recording.commit()
    assert polled(follower).ports[0].condition is Condition.NORMAL
    recording.facts.signals.remove("setpoint_c")  # of a recipe that does not record it
    recording.store.facts(recording.facts)
    recording.rows(1, setpoint_c=None, reasons="setpoint_c=disconnected")
    recording.commit()
    assert polled(follower).ports[0].condition is Condition.NORMAL


def test_a_tool_that_is_not_safe_is_a_failure(recording: Recording, follower: Follower) -> None:
    recording.rows(1)
    recording.facts.unsafe = ["dde-1 port 1: not confirmed"]
    recording.store.facts(recording.facts)
    recording.commit()
    assert {port.condition for port in polled(follower).ports} == {Condition.FAILED}


def test_a_station_without_rows_is_not_known(recording: Recording, follower: Follower) -> None:
    recording.commit()
    assert {port.condition for port in polled(follower).ports} == {Condition.NOT_KNOWN}


def test_a_damaged_commit_is_named_and_the_others_are_shown(recording: Recording) -> None:
    sizes = []
    for temperature in (300, 320, 340):
        recording.rows(3, temperature_c=temperature)
        recording.commit()
        sizes.append(journal_of(recording).stat().st_size)
    recording.close()
    data = bytearray(journal_of(recording).read_bytes())
    data[(sizes[0] + sizes[1]) // 2] ^= 1
    journal_of(recording).write_bytes(data)
    with Follower(recording.folder) as follower:
        run = whole(follower)
    assert len([text for text in run.problems if text.startswith("Damaged: ")]) == 1
    assert run.ports[0].coverage.due == 6


def journal_of(recording: Recording) -> Path:
    (path,) = segments(recording.folder)
    return path


# -- from the beginning to the end -----------------------------------------------------------------


def test_a_run_is_finalized_while_it_is_watched(recording: Recording, follower: Follower) -> None:
    recording.rows(20)
    recording.commit()
    assert whole(follower).ports[0].coverage.due == 20
    recording.rows(15, temperature_c=345)
    recording.event("run.end", "ended", station=None)
    recording.close()
    assert polled(follower).phase is Phase.FINALIZING
    recording.finalize()
    run = whole(follower)
    assert (run.phase, run.verdict, run.exit_status) == (Phase.FINALIZED, "ACCEPT", "success")
    port = run.ports[0]
    assert (port.condition, port.coverage.due, port.temperature.value) == (Condition.ENDED, 35, 345)
    assert not port.temperature.is_known  # nobody reads it any more
    assert [one.event.kind for one in run.events] == ["run.end"]
    again = polled(follower)
    assert (again.events, again.ports[0].coverage) == (run.events, port.coverage)


def test_hourly_sealing_changes_nothing(recording: Recording, follower: Follower) -> None:
    for _ in range(3):
        recording.rows(10)
        recording.event("host.busy", "late")
        recording.commit()
        before = whole(follower)
        recording.seal_part()
        run = whole(follower)
        assert [port.coverage for port in run.ports] == [port.coverage for port in before.ports]
        assert len(run.events) == len(before.events)
        with Follower(recording.folder) as late:
            assert [port.coverage for port in whole(late).ports] == [
                port.coverage for port in before.ports
            ]
    assert run.ports[0].coverage.due == 30
    assert len(run.events) == 3


def test_rows_in_a_part_and_still_in_the_store_count_once(recording: Recording) -> None:
    """As between the completion of a part and the removal of its segment."""
    recording.rows(10)
    recording.event("host.busy", "late")
    recording.commit()
    seal_journal(recording.folder)
    recording.rows(5)
    recording.commit()
    with Follower(recording.folder) as follower:
        run = whole(follower)
    assert run.ports[0].coverage.due == 15
    assert len(run.events) == 1


def test_a_run_that_is_finalized_during_a_poll(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording.rows(20)
    recording.commit()
    plain = RecordFollower.read

    def read(record: RecordFollower, manifest: Manifest | None) -> None:
        plain(record, manifest)
        monkeypatch.undo()
        recording.rows(15)
        recording.finalize()

    with Follower(recording.folder) as follower:
        whole(follower)
        monkeypatch.setattr(RecordFollower, "read", read)
        run = polled(follower)
    assert (run.phase, run.is_whole, run.ports[0].coverage.due) == (Phase.FINALIZED, True, 35)
    assert (run.ports[0].temperature.is_known, run.ports[0].temperature.why) == (False, "run ended")


def test_a_follower_that_was_stopped_over_a_sealing_misses_nothing(
    recording: Recording, follower: Follower
) -> None:
    recording.rows(10)
    recording.commit()
    whole(follower)
    for _ in range(2):
        recording.rows(10)
        recording.event("host.busy", "late")
        recording.seal_part()
    recording.rows(10)
    recording.commit()
    run = whole(follower)
    assert run.ports[0].coverage.due == 40
    assert len(run.events) == 2


def test_long_runs_are_read_in_pieces(recording: Recording, clock: StandingClock) -> None:
    for _ in range(150):
        recording.rows(2, temperature_c=300)
        recording.commit()
    recording.seal_part()
    for _ in range(120):
        recording.rows(1)
        recording.commit()
    with Follower(recording.folder, clock) as follower:
        first = polled(follower)
        assert first.ports[0].temperature.value == 350
        run = whole(follower)
    assert run.ports[0].temperature.value == 350  # older rows are read later, and stay older
    assert run.ports[0].coverage.due == 420
    assert run.ports[0].coverage.is_whole


def test_a_killed_recorder_is_seen_as_such(tmp_path: Path) -> None:
    with recorder(tmp_path) as process, Follower(tmp_path) as follower:
        wait_for(follower, Phase.RECORDING)
        process.send_signal(signal.SIGKILL)
        process.wait()
        run = wait_for(follower, Phase.CRASHED)
        assert "without finalizing" in run.text
        assert {port.condition for port in run.ports} == {Condition.STALE}
        assert not any(reading.is_known for port in run.ports for reading in port.readings.values())
        with Follower(tmp_path) as late:
            assert polled(late).phase is Phase.CRASHED


def test_a_new_run_takes_the_place_of_the_last(tmp_path: Path, clock: StandingClock) -> None:
    first = Recording(tmp_path)
    first.rows(3)
    first.commit()
    with Follower(tmp_path, clock) as follower:
        assert polled(follower).folder == first.folder
        first.finalize()
        assert polled(follower).phase is Phase.FINALIZED
        second = Recording(tmp_path, began_us=first.began_us + 60_000_000)
        second.rows(1)
        second.commit()
        run = polled(follower)
        assert (run.folder, run.phase, run.ports[0].coverage.due) == (
            second.folder,
            Phase.RECORDING,
            1,
        )
    second.abandon()


def test_a_run_that_is_recorded_comes_before_a_newer_one_that_ended(tmp_path: Path) -> None:
    long = Recording(tmp_path)
    long.rows(1)
    long.commit()
    short = Recording(tmp_path, began_us=long.began_us + 60_000_000)
    short.finalize()
    assert current_run(tmp_path) == long.folder
    long.abandon()


def test_a_folder_without_a_run(tmp_path: Path) -> None:
    (tmp_path / "notes").mkdir()
    with follow(tmp_path) as follower:
        assert follower.poll() is None
        recording = Recording(tmp_path)
        recording.commit()
        assert polled(follower).folder == recording.folder
        recording.abandon()


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="does not exist"):
        follow(tmp_path / "runs")


def test_a_folder_that_is_removed(recording: Recording, follower: Follower) -> None:
    recording.rows(1)
    recording.commit()
    polled(follower)
    shutil.rmtree(recording.folder)
    run = polled(follower)
    assert run.phase is Phase.GONE
    assert {port.condition for port in run.ports} == {Condition.STALE}


@pytest.mark.parametrize("moved", ["the folder", "its files"])
def test_a_folder_with_another_run_under_the_same_name_is_read_anew(
    tmp_path: Path, clock: StandingClock, moved: str
) -> None:
    """The header of one run over the rows and events of another would be false."""
    first = Recording(tmp_path / "runs")
    first.rows(30)
    first.commit()
    first.finalize()
    other = Recording(tmp_path / "elsewhere", began_us=first.began_us + 60_000_000)
    other.rows(2)
    other.commit()
    other.finalize()
    with Follower(tmp_path / "runs", clock) as follower:
        assert whole(follower).ports[0].coverage.due == 30
        if moved == "the folder":
            shutil.rmtree(first.folder)
            shutil.copytree(other.folder, first.folder)
        else:
            shutil.rmtree(first.folder / "samples")
            shutil.copytree(other.folder, first.folder, dirs_exist_ok=True)
        run = whole(follower)
        alone = whole(Follower(first.folder, clock))
    assert run.ports[0].coverage.due == 2
    assert (run.start, run.events) == (alone.start, alone.events)


def test_a_run_of_a_newer_jbclog_is_not_read(recording: Recording, follower: Follower) -> None:
    recording.rows(1)
    recording.commit()
    write_manifest(recording.folder, Manifest(recording.folder.name, schema=99))
    run = polled(follower)
    assert run.phase is Phase.UNREADABLE
    assert "written with schema 99" in run.text
    assert "use a newer jbclog" in run.text


def test_recording_continues_in_a_new_segment(
    recording: Recording, follower: Follower, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a sync that failed: the same rows are in both segments."""
    recording.rows(10)
    recording.commit()
    whole(follower)

    def fail(_: Disk, __: int) -> None:
        monkeypatch.undo()
        raise OSError(errno.EIO, "made up")

    for due in (20, 30):
        recording.rows(10)
        monkeypatch.setattr(Disk, "sync", fail)
        recording.commit()
        assert polled(follower).ports[0].coverage.due == due
    assert len(segments(recording.folder)) == 3
    with Follower(recording.folder) as late:
        assert whole(late).ports[0].coverage.due == 30


def test_a_crashed_run_is_recovered_while_it_is_watched(
    recording: Recording, follower: Follower, clock: StandingClock
) -> None:
    recording.rows(10)
    recording.commit()
    whole(follower)
    vanish(recording.store)
    polled(follower)
    clock.advance(5.0)
    assert polled(follower).phase is Phase.CRASHED
    recover(recording.folder)
    run = whole(follower)
    assert (run.phase, run.exit_status, run.ports[0].coverage.due) == (Phase.FINALIZED, "lost", 10)


def test_a_run_that_begins(tmp_path: Path, clock: StandingClock) -> None:
    folder = create_run(tmp_path, "bench", time.time())
    with Follower(tmp_path, clock) as follower:
        assert polled(follower).phase is Phase.STARTING
        write_manifest(folder, Manifest(folder.name))
        assert polled(follower).phase is Phase.STARTING
        clock.advance(10.0)
        assert polled(follower).phase is Phase.CRASHED  # nobody holds it


# -- the recorder does not notice ------------------------------------------------------------------


class recorder:  # noqa: N801  # used as a function
    """A recorder in a process of its own."""

    def __init__(self, out: Path) -> None:
        self._out = out

    def __enter__(self) -> subprocess.Popen[str]:
        self._process = subprocess.Popen(
            program("records.live_rows", self._out), stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout is not None
        self.folder = self._out / self._process.stdout.readline().strip()
        return self._process

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()


def wait_for(follower: Follower, phase: Phase) -> RunState:
    end = time.monotonic() + WAIT_S
    while (state := follower.poll()) is None or state.phase is not phase or not state.ports:
        assert time.monotonic() < end, state
        time.sleep(0.1)
    return state


def test_the_lock_of_a_live_recorder_is_not_even_tested(
    recording: Recording, clock: StandingClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("jbclog.live.run_follower.is_held", lambda _: pytest.fail("tested"))
    recording.rows(1)
    recording.commit()
    with Follower(recording.out, clock) as follower:
        for _ in range(3):
            clock.advance(1.0)
            assert polled(follower).phase is Phase.RECORDING
            recording.commit()


def last_changes(folder: Path) -> dict[str, int]:
    """When each file was changed."""
    return {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}


def test_following_changes_no_file(recording: Recording) -> None:
    recording.rows(5)
    stop_writing(recording)
    before = last_changes(recording.folder)
    with Follower(recording.folder) as follower:
        whole(follower)
    assert last_changes(recording.folder) == before


def test_a_user_without_write_permission_can_follow(
    recording: Recording, clock: StandingClock
) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root, to become somebody else")
    recording.rows(5)
    recording.commit()
    for folder in (recording.folder, *recording.folder.parents):
        if folder.stat().st_mode & 0o005 != 0o005:
            folder.chmod(0o755)
    child = os.fork()
    if child == 0:
        os.setgid(65_534)
        os.setuid(65_534)
        with suppress(BaseException), Follower(recording.folder, clock) as follower:
            os._exit(0 if polled(follower).ports[0].condition is Condition.NORMAL else 3)
        os._exit(4)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@pytest.mark.parametrize(
    ("commits", "most_s"), [(3, WAIT_S), pytest.param(40, 1.0, marks=pytest.mark.campaign)]
)
def test_a_stream_of_64_ports_is_at_most_a_second_behind_the_commit(
    tmp_path: Path, commits: int, most_s: float
) -> None:
    """By the clock, so on a machine that has time."""
    recording, committed = Recording(tmp_path, tuple(range(1, 65))), list[float]()

    def record() -> None:
        for _ in range(commits):
            recording.rows(10)
            recording.commit()
            committed.append(time.monotonic())
            time.sleep(0.97)  # so that commits and looks drift along each other

    recorder = threading.Thread(target=record)
    behind: list[float] = []
    with follow(recording.folder) as follower:
        recorder.start()
        for run in follower.stream():
            seen = run.ports[0].coverage.due // 10 if run.ports else 0
            behind += [time.monotonic() - at for at in committed[len(behind) : seen]]
            if len(behind) == commits:
                break
    recorder.join()
    recording.abandon()
    print(
        f"behind the commit: {sum(behind) / commits:.2f} s on average, {max(behind):.2f} s at most"
    )
    assert max(behind) <= most_s
