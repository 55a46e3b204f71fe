"""What a recording says of its run."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.replay import open_recording, plan_of
from jbclog.core.errors import RecordError, UsageError
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


def test_without_a_manifest_the_wires_say_what_was_ordered(folder: Path) -> None:
    recording = open_recording(folder)
    assert recording.manifest is None
    assert recording.metadata.tags == {"replay_of": "run"}
    plan = plan_of(recording)
    assert (plan.wanted.rate, plan.wanted.duration_s, plan.wanted.guard) == ("fit", None, False)
    assert [station.spec.name for station in plan.stations] == ["dde-1"]


def test_the_metadata_of_the_run_is_kept(folder: Path) -> None:
    metadata = Metadata("A. Rossi", units=["1", "2"], tags={"shift": "3"})
    write_manifest(folder, Manifest(folder.name, state="sealed", metadata=metadata))
    told = open_recording(folder).metadata
    assert (told.operator, told.units, told.tags) == (
        "A. Rossi",
        ("1", "2"),
        {"shift": "3", "replay_of": "run"},
    )


def test_folders_that_are_no_recording(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="only a run recorded with --capture can be replayed"):
        open_recording(tmp_path)
    (tmp_path / "wire").mkdir()
    (tmp_path / "wire" / "dde-1.tsv.gz").write_bytes(b"")
    with pytest.raises(RecordError, match="is not a serial capture: it is empty"):
        open_recording(tmp_path)
