"""What a recording says of its run, and the line file with which it is recorded again."""

from __future__ import annotations

from pathlib import Path

import pytest
from taped import recorded
from virtual_run import line_text

from jbclog.clock import VirtualClock
from jbclog.errors import RecordError, UsageError
from jbclog.recipe.line import load_line
from jbclog.record.manifest import Manifest, Metadata, write_manifest
from jbclog.replaying import Recording, open_recording, plan_of, serve
from jbclog.rows import StationFacts


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    run = tmp_path / "run"
    recorded(
        run, line_text(), duration_s=None, rate="fit", arrange=lambda run: run.at(2.5, lambda: run.driver.end("ended by SIGINT"))
    )
    return run


def facts(name: str, period_s: float | None, ticks: int) -> StationFacts:
    return StationFacts(name, "x", "dde", period_s=period_s, first_tick=10, last_tick=9 + ticks)


def with_manifest(folder: Path, *stations: StationFacts) -> Recording:
    metadata = Metadata("A. Rossi", units=["1", "2"], tags={"shift": "3"})
    write_manifest(folder, Manifest(folder.name, state="sealed", stations=list(stations), metadata=metadata))
    return open_recording(folder)


def test_without_a_manifest_the_wires_say_what_was_ordered(folder: Path) -> None:
    recording = open_recording(folder)
    assert (recording.rate, recording.sampled_s, recording.manifest) == ("fit", None, None)
    assert recording.metadata.tags == {"replay_of": "run"}
    plan = plan_of(recording)
    assert (plan.wanted.rate, plan.wanted.duration_s, plan.wanted.guard) == ("fit", None, False)
    assert [station.spec.name for station in plan.stations] == ["dde-1"]


def test_what_came_of_a_rate_and_of_a_run_that_was_ended(folder: Path) -> None:
    assert with_manifest(folder, facts("dde-1", 0.1, 25)).rate == 10.0
    assert with_manifest(folder, facts("dde-1", 0.1, 25)).sampled_s == pytest.approx(2.5)
    two = with_manifest(folder, facts("dde-1", 0.1, 25), facts("dde-2", 0.2, 15))
    assert (two.rate, two.sampled_s) == ("fit", pytest.approx(3.0))
    assert with_manifest(folder, facts("dde-1", None, 25)).sampled_s is None
    told = two.metadata
    assert (told.operator, told.units, told.tags) == ("A. Rossi", ("1", "2"), {"shift": "3", "replay_of": "run"})


@pytest.mark.parametrize(("speed", "baudrate"), [(1.0, 19200), (2.0, 38400), (10.0, 230400), (100.0, 500000), (0.5, 9600)])
def test_the_line_file_names_the_recipe_that_ran_and_a_line_that_is_fast_enough(
    folder: Path, tmp_path: Path, speed: float, baudrate: int
) -> None:
    server, (station,) = serve(open_recording(folder), tmp_path / "served", speed=speed)
    server.close()
    (spec,) = load_line(tmp_path / "served" / "line.toml").stations
    assert spec.recipe == folder / "recipes" / "recipe.toml"
    assert (spec.name, spec.baudrate, spec.url) == ("dde-1", baudrate, str(tmp_path / "served" / "dde-1"))
    (reply, *_) = station.receive(b"\x020001RSMN\x03\x02", VirtualClock().monotonic())
    assert reply.data.startswith(b"\x020100ASMN")


def test_folders_that_are_no_recording(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="only a run with --wire can be replayed"):
        open_recording(tmp_path)
    (tmp_path / "wire").mkdir()
    (tmp_path / "wire" / "dde-1.tsv.gz").write_bytes(b"")
    with pytest.raises(RecordError, match="is no wire record: it is empty"):
        open_recording(tmp_path)
