"""What a recording says of its run, and the line file with which it is recorded again."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.replay import Recording, open_recording, plan_of, serve
from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.app.run.tasks import station_tasks
from jbclog.config.line import load_line
from jbclog.core.clock import VirtualClock
from jbclog.core.errors import Problems, RecordError, UsageError
from jbclog.core.rows import StationFacts
from jbclog.record.manifest import Manifest, Metadata, write_manifest
from support.virtual.captured_run import recorded
from support.virtual.virtual_run import line_text


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    run = tmp_path / "run"
    recorded(
        run,
        line_text(),
        duration_s=None,
        rate="fit",
        arrange=lambda run: run.at(2.5, lambda: run.driver.end("ended by SIGINT")),
    )
    return run


def facts(name: str, period_s: float | None, ticks: int) -> StationFacts:
    return StationFacts(name, "x", "dde", period_s=period_s, first_tick=10, last_tick=9 + ticks)


def with_manifest(folder: Path, *stations: StationFacts) -> Recording:
    metadata = Metadata("A. Rossi", units=["1", "2"], tags={"shift": "3"})
    write_manifest(
        folder, Manifest(folder.name, state="sealed", stations=list(stations), metadata=metadata)
    )
    return open_recording(folder)


def test_without_a_manifest_the_wires_say_what_was_ordered(folder: Path) -> None:
    recording = open_recording(folder)
    assert (
        recording.rates_hz,
        recording.ticks("dde-1"),
        recording.sampled_s,
        recording.manifest,
    ) == ({}, None, None, None)
    assert recording.metadata.tags == {"replay_of": "run"}
    plan = plan_of(recording)
    assert (plan.wanted.rate, plan.wanted.duration_s, plan.wanted.guard) == ("fit", None, False)
    assert [station.spec.name for station in plan.stations] == ["dde-1"]


def test_what_came_of_a_rate_and_of_a_run_that_was_ended(folder: Path) -> None:
    one = with_manifest(folder, facts("dde-1", 0.1, 25))
    assert (one.rates_hz, one.sampled_s) == ({"dde-1": 10.0}, pytest.approx(2.5))
    assert one.ticks("dde-1") == (pytest.approx(1001.0), 0.1)
    two = with_manifest(folder, facts("dde-1", 0.1, 25), facts("dde-2", 0.2, 15))
    assert (two.rates_hz, two.sampled_s) == ({"dde-1": 10.0, "dde-2": 5.0}, pytest.approx(3.0))
    without = with_manifest(folder, facts("dde-1", None, 25))
    assert (without.sampled_s, without.rates_hz, without.ticks("dde-1")) == (None, {}, None)
    told = two.metadata
    assert (told.operator, told.units, told.tags) == (
        "A. Rossi",
        ("1", "2"),
        {"shift": "3", "replay_of": "run"},
    )


def test_the_line_file_has_the_recipe_and_the_rate_of_the_run(folder: Path, tmp_path: Path) -> None:
    recording = with_manifest(folder, facts("dde-1", 0.1, 25))
    server, (station,) = serve(recording, tmp_path / "served")
    server.close()
    line = load_line(tmp_path / "served" / "line.toml")
    (spec,) = line.stations
    assert spec.recipe == folder / "recipes" / "recipe.toml"
    assert (spec.name, spec.baudrate, spec.url) == (
        "dde-1",
        19200,
        str(tmp_path / "served" / "dde-1"),
    )
    assert line.replay is not None
    assert line.replay.rate_hz == {"dde-1": 10.0}
    (plan,) = make_plan(RunOptions(line.path)).stations
    assert plan.rate == 10.0
    (order,) = station_tasks(make_plan(RunOptions(line.path)), 0.0)
    assert order.is_replay
    reply, *_ = station.receive(b"\x020001RSMN\x03\x02", VirtualClock().monotonic())
    assert reply.data.startswith(b"\x020100ASMN")


@pytest.mark.parametrize(
    ("url", "is_fine"),
    [
        ("dde-1", True),
        ("socket://127.0.0.1:7001", True),
        ("socket://localhost:7001", True),
        ("socket://[::1]:7001", True),
        ("socket://10.0.0.7:7001", False),
        ("rfc2217://localhost:7001", False),
        ("/dev/ttyUSB0", False),
        ("COM3", False),
        ("linked", False),
    ],
)
def test_no_real_station_is_asked_at_the_pace_of_a_recorded_one(
    folder: Path, tmp_path: Path, url: str, is_fine: bool
) -> None:
    server, _ = serve(with_manifest(folder, facts("dde-1", 0.1, 25)), tmp_path / "served")
    server.close()
    path = tmp_path / "served" / "line.toml"
    path.write_text(path.read_text().replace('url = "dde-1"', f'url = "{url}"'))
    (tmp_path / "served" / "linked").symlink_to("/dev/null")  # a device that is no pseudo-terminal
    assert load_line(path).replay is not None  # as it stands in old runs, it can be read
    if is_fine:
        make_plan(RunOptions(path))
    else:
        with pytest.raises(Problems, match="must not run with the timing of"):
            make_plan(RunOptions(path))


def test_another_speed_than_one_is_refused(folder: Path, tmp_path: Path) -> None:
    """Line files of releases 1 and 2 may have it."""
    server, _ = serve(with_manifest(folder, facts("dde-1", 0.1, 25)), tmp_path / "served")
    server.close()
    path = tmp_path / "served" / "line.toml"
    text = path.read_text()
    path.write_text(text.replace("[replay]\n", "[replay]\nspeed = 1.0\n"))
    assert load_line(path).replay is not None
    path.write_text(text.replace("[replay]\n", "[replay]\nspeed = 10.0\n"))
    with pytest.raises(Problems, match=r"replay\.speed"):
        load_line(path)


def test_folders_that_are_no_recording(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="only a run recorded with --capture can be replayed"):
        open_recording(tmp_path)
    (tmp_path / "wire").mkdir()
    (tmp_path / "wire" / "dde-1.tsv.gz").write_bytes(b"")
    with pytest.raises(RecordError, match="is not a serial capture: it is empty"):
        open_recording(tmp_path)
