"""A recorded run served again on pseudo-terminals: the decoded tables are equal."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pytest

from jbclog.analysis.run import Run, open_run
from jbclog.record.capture import wire_path
from jbclog.record.check import check
from jbclog.record.manifest import read_manifest
from jbclog.sim.process import SimProcess
from support.campaigns.awaited import CAPTURE_LACKS, RECORDING_ENDS
from support.command import RECIPE, is_sampling, jbclog, only_run, started, until
from support.invoked import invoked
from support.readers.run_files import read_rows

LINE = """
[line]
name = "field"

[[station]]
name = "dde-1"
url = "dde-1"
family = "dde"
ports = [1]
[station.sim]
noise_c = 0.5
[[station.sim.fault]]
kind = "flip"
bits = 1
at_s = 0.6
every = 9
[[station.sim.fault]]
kind = "dropout"
at_s = 3.2
for_s = 0.7

[[station]]
name = "ucr-1"
url = "ucr-1"
family = "ucr"
[station.sim]
noise_c = 0.5
[[station.sim.fault]]
kind = "silence"
at_s = 0.6
every = 23
"""
HZ, SECONDS = 5, 3
EXIT_STATION, EXIT_SAFETY = 3, 5
FAST = ["temperature_c", "power_permille", "status"]
SLOW = [
    "set_c",
    "tool",
    "port_error",
    "station_error",
    "alarm_high",
    "transformer_c",
    "transistor_c",
]


@contextmanager
def served(run: Path, folder: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """Run `jbclog replay` until its ports are there; end it with Ctrl-C."""
    process = started("replay", run, "--dir", folder, *options)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == f"{folder / 'line.toml'}\n"
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=200)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in the field: corrupt frames and an outage on one station, time-outs on the other.

    The cable is out at a fixed time after the station's start. On a busy machine the run may be
    starting then, or over; another run is made, with the cable out later or sooner. It is also made
    again if the host was late: such a host loses answers for longer than a station may be silent.
    """
    cable_out_at_s = 3.2
    for _ in range(12):
        place = tmp_path_factory.mktemp("field")
        ended = recorded_in(place, cable_out_at_s)
        run = only_run(place / "runs")
        if ended.returncode == EXIT_STATION:
            cable_out_at_s += 1.0
            continue
        if ended.returncode == EXIT_SAFETY:  # a host so late that no answer proved a safe state
            continue
        assert ended.returncode in (0, 1), ended.stderr
        if lost_while_sampling(run) == {"dde-1": 1, "ucr-1": 0}:
            passed = passed_in(run)
            if passed == WITH_OUTAGE and counters_were_read(run):
                return run
        elif "lost" in passed_in(run):
            cable_out_at_s += 1.0
        else:
            cable_out_at_s -= 0.3
    pytest.fail(f"no run of twelve had the cable out while it sampled: {ended.stderr}")


WITH_OUTAGE = ["opened", "lost", "failed", "opened", "closed"]


def lost_while_sampling(run: Path) -> dict[str, int]:
    """Return how often the link of each station was lost during sampling."""
    return {one.name: one.outages for one in read_manifest(run).stations}


def passed_in(run: Path) -> list[str]:
    """Return what happened to the port, in order and without repetitions. During the outage it is
    tried at least once.
    """
    of_port = ("opened", "lost", "failed", "closed")
    passed = [row.what for row in read_rows(wire_path(run, "dde-1")) if row.what in of_port]
    return [what for number, what in enumerate(passed) if what not in passed[:number][-1:]]


LATE, AT_START = "<timeout>", 8
"""Raw text of a counter without an answer; number of counters read before the first sample."""


def raw_counters(run: Path, station: str) -> list[str]:
    return list(open_run(run).counters(station)["raw"])


def in_time(raw: list[str]) -> int:
    """Return how many counters were read before the first one without an answer."""
    return [*raw, LATE].index(LATE)


def counters_were_read(run: Path) -> bool:
    """Whether all counters before the first sample were answered."""
    return all(in_time(raw_counters(run, name)) >= AT_START for name in ("dde-1", "ucr-1"))


def recorded_in(place: Path, cable_out_at_s: float) -> subprocess.CompletedProcess[str]:
    (place / "line.toml").write_text(LINE.replace("at_s = 3.2", f"at_s = {cable_out_at_s}"))
    with SimProcess(place / "line.toml", place / "bench") as stations:
        options = (
            "--line",
            stations.line_path,
            "--out",
            place / "runs",
            "-d",
            f"{SECONDS}s",
            "--rate",
            str(HZ),
            "--order",
            "A 7",
        )
        return jbclog("run", RECIPE, *options, "--capture")


def rows(run: Path, station: str) -> pd.DataFrame:
    samples = open_run(run).samples(station=station)
    return samples.assign(tick=samples["tick"] - samples["tick"].min()).set_index("tick")


def test_every_byte_is_in_the_runs_folder(original: Path) -> None:
    assert check(original) == []
    manifest = read_manifest(original)
    assert manifest.wire == "whole"
    assert {file.path for file in manifest.files} >= {"wire/dde-1.tsv.gz", "wire/ucr-1.tsv.gz"}
    passed = list(read_rows(wire_path(original, "dde-1")))
    assert any(row.what == "failed" for row in passed)
    assert sum(row.what == "sent" for row in passed) > len(rows(original, "dde-1")) * 3


def test_lived_through_again_the_tables_are_the_same(original: Path, tmp_path: Path) -> None:
    ended = jbclog("replay", original, "--record", tmp_path / "again")
    again = only_run(tmp_path / "again")
    assert (ended.returncode, ended.stdout) == (0, f"{again}\n"), ended.stderr
    counted, same = ended.stderr.splitlines()
    samples = len(open_run(original).samples())
    assert counted.startswith(f"compared: {samples} of {samples} rows of samples, ")
    assert same == "decoded tables are equal"
    assert check(again) == []
    before, after = open_run(original).samples(), open_run(again).samples()
    pd.testing.assert_frame_equal(before.drop(columns="time"), after.drop(columns="time"))
    assert (before["time"] - after["time"]).abs().max() < pd.Timedelta("50ms")
    manifest = read_manifest(again)
    assert manifest.metadata.tags == {"replay_of": original.name}
    assert manifest.metadata.order == "A 7"
    assert manifest.verdict == read_manifest(original).verdict
    # not the original's name: that folder was there before its guard was started
    started_at = pd.Timestamp(read_manifest(original).started)
    assert again.name[:16] == f"{started_at:%Y%m%dT%H%M%SZ}"


def test_recorded_again_at_its_own_pace(original: Path, tmp_path: Path) -> None:
    """If the host loses so many answers that a link counts as lost, the trial shows nothing, and
    another follows.
    """
    for trial in range(4):
        ended = recorded_again(original, tmp_path / str(trial))
        again = only_run(tmp_path / str(trial) / "runs")
        if (
            ended.returncode in (0, 1)
            and counters_were_read(again)
            and lost_while_sampling(again) == lost_while_sampling(original)
        ):
            break
    assert ended.returncode in (0, 1), ended.stderr
    first, second = open_run(original), open_run(again)
    for station in ("dde-1", "ucr-1"):
        ours, theirs = rows(original, station), rows(again, station)
        assert len(theirs) == len(ours) == HZ * SECONDS
        for column in (*FAST, *SLOW):
            assert is_in_order(theirs[column], ours[column]), column
        if (
            was_on_time(ours)
            and was_on_time(theirs)
            and all(abs(theirs[one].count() - ours[one].count()) <= 1 for one in FAST)
        ):
            for column in FAST:
                assert share_of_same(ours[column], theirs[column]) > 0.8, column
            # when the wire has room for them is a matter of fractions of a millisecond
            for column in SLOW:
                assert abs(theirs[column].count() - ours[column].count()) <= 1, column
        written = ["port", "setting", "requested", "written", "readback", "outcome"]
        pd.testing.assert_frame_equal(
            first.settings(station)[written], second.settings(station)[written]
        )
        before, after = raw_counters(original, station), raw_counters(again, station)
        # a host that is late loses an answer, and what follows is asked at other times
        whole = min(in_time(before), in_time(after))
        assert after[:whole] == before[:whole]
        assert whole >= AT_START
        assert kinds(second, station) == kinds(first, station)


def recorded_again(original: Path, place: Path) -> subprocess.CompletedProcess[str]:
    """Record the served run with the command that `replay` proposes."""
    place.mkdir()
    with served(original, place / "served") as replaying:
        assert replaying.stderr is not None
        replaying.stderr.readline()
        typed = shlex.split(replaying.stderr.readline())
        assert typed[:2] == ["jbclog", "run"]
        assert {"--duration", "--order", "A 7"} < set(typed)
        return jbclog(*typed[1:], "--out", place / "runs")


def was_on_time(samples: pd.DataFrame) -> bool:
    """Whether the host asked the first question of each tick within the tick's first tenth:
    otherwise values move to other ticks.
    """
    return samples["late_us"].max() is not pd.NA and bool(samples["late_us"].max() < 0.1e6 / HZ)


def share_of_same(ours: pd.Series, theirs: pd.Series) -> float:
    """Return the share of their values that equal ours at the same tick or a neighbour; 1.0 without
    values to compare.

    A busy host asks late, and the served run then gives the value of the next tick.
    """
    both = ours.notna() & theirs.notna()
    same = (
        pd.concat([ours.shift(by) == theirs for by in (-1, 0, 1)], axis=1).fillna(False).any(axis=1)
    )
    return float(same[both].mean()) if both.any() else 1.0


def is_in_order(read: pd.Series, of: pd.Series) -> bool:
    """Whether the values read are values of the other run in the same order, each for any number of
    ticks.

    The capture has answers that the rows of the other run do not show, and the served station gives
    them: the one before the first row, to a host that starts sooner, and one that came too late for
    its tick, where the other run has a null.
    """
    left = iter(of)
    return all(any(one is pd.NA or one == value for one in left) for value in changes(read)[1:])


def changes(column: pd.Series) -> list[int]:
    """Return the values read, each one once until it changes."""
    known = column.dropna()
    return known[(known != known.shift()).fillna(True)].to_list()


def kinds(run: Run, station: str) -> list[str]:
    """Return the kinds of events, without those of a busy host; a slow signal that was not read may
    be reported after the end.
    """
    of_the_host = ("read.", "alarm.", "host.", "station.slow")
    return [kind for kind in run.events(station)["kind"] if not kind.startswith(of_the_host)]


CALM = re.sub(r"\[\[station.sim.fault\]\].*?(?=\n\n|\Z)", "", LINE, flags=re.DOTALL)


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two stations without faults, each with its own period."""
    place = tmp_path_factory.mktemp("calm")
    (place / "line.toml").write_text(
        CALM.replace("noise_c = 0.5", "noise_c = 0.5\nturnaround_ms = 60.0", 1)
    )
    with SimProcess(place / "line.toml", place / "bench") as stations:
        ended = jbclog(
            "run",
            RECIPE,
            "--line",
            stations.line_path,
            "--out",
            place / "runs",
            "-d",
            "6s",
            "--rate",
            "fit",
            "--capture",
        )
    assert ended.returncode in (0, 1), ended.stderr
    return only_run(place / "runs")


@pytest.mark.campaign
def test_recorded_again_it_has_the_same_rows(calm: Path, tmp_path: Path) -> None:
    """Each station has as many rows as before, at its own rate, and the same values unless the host
    lost a tick.
    """
    with served(calm, tmp_path / "served") as replaying:
        assert replaying.stderr is not None
        replaying.stderr.readline()
        typed = shlex.split(replaying.stderr.readline())
        ended = jbclog(*typed[1:], "--out", tmp_path / "runs")
    assert ended.returncode in (0, 1), ended.stderr
    again = only_run(tmp_path / "runs")
    first, second = read_manifest(calm), read_manifest(again)
    assert [one.period_s for one in second.stations] == pytest.approx(
        [one.period_s for one in first.stations]
    )
    assert len({one.period_s for one in first.stations}) == 2
    for station in ("dde-1", "ucr-1"):
        ours, theirs = rows(calm, station), rows(again, station)
        assert len(ours) == len(theirs)
        on_time = (ours["late_us"] < 10_000) & (theirs["late_us"] < 10_000)
        for column in FAST:
            assert share_of_same(ours[on_time][column], theirs[on_time][column]) > 0.9
        assert set(kinds(open_run(calm), station)) <= set(kinds(open_run(again), station))
        assert (
            open_run(again).counters(station)["raw"].to_list()
            == open_run(calm).counters(station)["raw"].to_list()
        )


# -- nothing compared is no success ----------------------------------------------------------------


@pytest.fixture
def copied(calm: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(calm, tmp_path / calm.name))


def held(run: Path, out: Path) -> tuple[int, dict[str, object]]:
    ended = invoked("replay", run, "--record", out, "--json")
    return ended.exit_code, json.loads(ended.stdout)


def test_a_station_whose_wire_is_gone_is_told_and_no_success(copied: Path, tmp_path: Path) -> None:
    wire_path(copied, "ucr-1").unlink()
    code, told = held(copied, tmp_path / "again")
    assert (code, told["same"]) == (1, False)
    recorded = len(rows(copied, "ucr-1"))
    assert f"samples, ucr-1: only 0 of {recorded} rows could be compared" in str(told["uncompared"])


@pytest.mark.parametrize("size", [2500, 6000])
def test_a_wire_that_was_cut_is_told_with_its_share_and_no_success(
    copied: Path, tmp_path: Path, size: int
) -> None:
    for station in ("dde-1", "ucr-1"):
        os.truncate(wire_path(copied, station), size)
    code, told = held(copied, tmp_path / "again")
    assert (code, told["same"], told["differences"]) == (1, False, [])
    compared = told["compared"]
    assert isinstance(compared, dict)
    assert compared["samples"]["rows"] < compared["samples"]["recorded"]
    assert told["uncompared"]


def test_a_row_too_many_is_a_difference(
    copied: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A comparison of the common part misses an extra row; only a recording that was cut off is
    compared that way.
    """
    from jbclog.app.run.run_record import RunRecord
    from jbclog.core.rows import EventRow, Severity

    close = RunRecord.close

    def with_another(run_record: RunRecord) -> str | None:
        run_record.journal.event(
            EventRow(
                run_record.utc.micros(run_record.clock.monotonic()),
                "x.more",
                Severity.INFO,
                "More.",
                "dde-1",
            )
        )
        return close(run_record)

    monkeypatch.setattr(RunRecord, "close", with_another)
    code, told = held(copied, tmp_path / "again")
    assert code == 1
    assert re.search(r"events, dde-1: \d+ rows instead of \d+", str(told["differences"]))


@pytest.mark.campaign
def test_a_recorder_that_was_killed_leaves_all_but_the_last_second(tmp_path: Path) -> None:
    (tmp_path / "line.toml").write_text(LINE.replace("dropout", "overheat"))
    with SimProcess(tmp_path / "line.toml", tmp_path / "bench") as stations:
        options = (
            "--line",
            stations.line_path,
            "--out",
            tmp_path / "runs",
            "--rate",
            str(HZ),
            "--capture",
        )
        recorder = started("run", RECIPE, *options)
        assert until(lambda: is_sampling(tmp_path / "runs"))
        run = only_run(tmp_path / "runs")
        wire = wire_path(run, "dde-1")
        assert until(lambda: wire.stat().st_size > 5000)
        os.kill(recorder.pid, signal.SIGKILL)
        recorder.communicate()
    assert jbclog("recover", run).returncode == 0
    assert check(run) == []
    assert f"{CAPTURE_LACKS} 1 s" in (read_manifest(run).wire or "")
    last, samples = max(row.at_s for row in read_rows(wire)), open_run(run).samples(station="dde-1")
    t0 = read_manifest(run).t0_mono or 0.0
    assert samples["tick"].max() / HZ < last - t0 + 1.0
    again = jbclog("replay", run, "--record", tmp_path / "again", "--json")
    assert again.returncode == 0, again.stdout + again.stderr
    told = json.loads(again.stdout)
    assert (told["run"], told["same"], told["differences"]) == (
        str(only_run(tmp_path / "again")),
        True,
        [],
    )
    assert re.search(
        rf"dde-1: {RECORDING_ENDS} [\d.]+ s after the run's start, before its session",
        told["left"][0],
    )


def test_wrong_usage(original: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    for arguments, why in (
        (
            [str(original), "--record", "again", "--dir", "x"],
            "--record serves no stations: omit --dir and --tcp",
        ),
        (["nowhere"], "no such folder"),
        (["empty"], "only a run recorded with --capture can be replayed"),
        ([str(original), "--dir", str(original)], "would be overwritten"),
    ):
        ended = invoked("replay", *arguments)
        assert (ended.exit_code, ended.stdout) == (2, "")
        assert why in ended.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]
    assert check(original) == []
