"""The rows of a serial capture come back as they were, and what is lost is named."""

from __future__ import annotations

import math
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.core.capture_rows import (
    CaptureRow,
    LinkRow,
    LinkRowKind,
    RequestName,
    ResultKind,
    ResultRow,
)
from jbclog.record import wire_recorder
from jbclog.record.frames import Commit, read_items
from jbclog.record.journal_reader import Segment
from jbclog.record.parts import part_paths
from jbclog.record.wire import (
    captured_rows,
    heads_of,
    losses,
    rows_in,
    seal_capture,
    segments,
)
from jbclog.record.wire_recorder import Head, WireRecorder
from support.links.small_wire import HEAD, ROWS, pieces, write_wire

TIMES = st.floats(0, 1e8, allow_nan=False)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
SIZES = st.integers(0, 1 << 20)
LINK_ROWS = st.builds(
    LinkRow, TIMES, st.sampled_from(get_args(LinkRowKind)), st.binary(max_size=60), TEXTS
)
RESULT_ROWS = st.builds(
    ResultRow,
    TIMES,
    st.sampled_from(get_args(ResultKind)),
    st.sampled_from(get_args(RequestName)),
    SIZES,
    TIMES,
    TEXTS,
    TIMES,
)
COMMITS = st.lists(
    st.lists(st.tuples(st.sampled_from("ab"), LINK_ROWS | RESULT_ROWS), max_size=20), max_size=5
)


def head_of(station: str) -> Head:
    return Head(
        station, f"/dev/{station}", "tht.toml", 8123.480001251, 1_790_000_000.25, rate="fit"
    )


def rows_of_segment(path: Path) -> list[pa.Table]:
    with path.open("rb") as file:
        return list(Segment(path, file, "run").rows("wire"))


@given(COMMITS)
def test_any_rows_come_back_from_frames_and_from_parquet(
    commits: list[list[tuple[str, CaptureRow]]],
) -> None:
    with tempfile.TemporaryDirectory() as home:
        folder = Path(home)
        recorder = WireRecorder(folder)
        keep = {station: recorder.begin(head_of(station)) for station in "ab"}
        for commit in commits:
            for station, row in commit:
                keep[station](row)
            recorder.write()
        recorder.close()
        assert recorder.trouble is None
        given_rows = [pair for commit in commits for pair in commit]
        (segment,) = segments(folder)
        live = [row for rows in rows_of_segment(segment) for row in rows_in(rows)]
        seal_capture(folder)
        assert segments(folder) == []
        assert heads_of(folder) == {station: head_of(station) for station in "ab"}
        sealed = []
        for station in "ab":
            rows = list(captured_rows(folder, station))
            assert rows == [row for name, row in given_rows if name == station]
            sealed += rows
        assert sorted(live, key=repr) == sorted(sealed, key=repr)


@pytest.fixture
def segment(tmp_path: Path) -> Path:
    write_wire(tmp_path)
    (path,) = segments(tmp_path)
    return path


def test_a_capture_that_lacks_nothing(segment: Path) -> None:
    seal_capture(segment.parent)
    assert losses(segment.parent) == []
    assert list(captured_rows(segment.parent, HEAD.station)) == ROWS


@pytest.mark.parametrize("number", range(1, len(list(pieces())) - 1))
def test_a_damaged_commit_costs_its_rows_and_is_named(segment: Path, number: int) -> None:
    with segment.open("rb") as file:
        commits = [item for item in read_items(file) if isinstance(item, Commit)]
    data = bytearray(segment.read_bytes())
    data[commits[number].end - 1] ^= 1
    segment.write_bytes(data)
    before = [row for piece in list(pieces())[:number] for row in piece]
    lost = len(list(pieces())[number])
    seal_capture(segment.parent)
    assert list(captured_rows(segment.parent, HEAD.station)) == before
    (loss,) = losses(segment.parent)
    assert loss.startswith(f"{lost} rows before row {1 + len(before) + lost} are missing")


@pytest.mark.parametrize("share", [0.5, 0.7, 0.9])
def test_of_a_capture_that_was_cut_off_the_whole_commits_are_there(
    segment: Path, share: float
) -> None:
    os.truncate(segment, int(segment.stat().st_size * share))
    seal_capture(segment.parent)
    rows = list(captured_rows(segment.parent, HEAD.station))
    assert rows == ROWS[: len(rows)]
    assert len(rows) < len(ROWS)
    assert losses(segment.parent) == [f"the session of {HEAD.station} has no end"]


def test_sealing_that_was_killed_takes_each_row_once(segment: Path) -> None:
    kept = shutil.copy(segment, segment.with_name("kept"))
    seal_capture(segment.parent)
    shutil.move(kept, segment)  # it was not removed before the kill
    seal_capture(segment.parent)
    assert segments(segment.parent) == []
    assert list(captured_rows(segment.parent, HEAD.station)) == ROWS


def test_a_long_capture_has_several_segments_and_the_last_is_not_sealed_while_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wire_recorder, "ROWS_A_SEGMENT", 5)
    recorder = WireRecorder(tmp_path)
    keep = recorder.begin(HEAD)
    for number, piece in enumerate(pieces()):
        for row in piece:
            keep(row)
        recorder.write()
        if number == 3:
            seal_capture(tmp_path, is_open=True)
    recorder.close()
    assert len(segments(tmp_path)) > 1
    seal_capture(tmp_path)
    assert len(part_paths(tmp_path, "wire")) > 2
    assert losses(tmp_path) == []
    assert list(captured_rows(tmp_path, HEAD.station)) == ROWS


# -- a disk that fails -----------------------------------------------------------------------------


def fails_at(place: int) -> Callable[[int, bytes], int]:
    """Return a write that writes half, and then fails, from the call `place` on."""
    calls = 0

    def write(descriptor: int, data: bytes) -> int:
        nonlocal calls
        calls += 1
        if calls > place + 1:
            raise OSError(5, "Input/output error")
        return plain(descriptor, data[: len(data) // 2] if calls == place + 1 else data)

    plain = os.write
    return write


@pytest.mark.parametrize("place", range(4))
def test_a_disk_that_fails_ends_the_capture_and_leaves_whole_commits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: int
) -> None:
    with monkeypatch.context() as patches:
        patches.setattr(os, "write", fails_at(place))
        write_wire(tmp_path)
    seal_capture(tmp_path)
    rows = list(captured_rows(tmp_path, HEAD.station))
    assert rows == [row for piece in list(pieces())[:place] for row in piece]
    assert bool(heads_of(tmp_path)) == (place > 0)


def test_trouble_is_news_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = WireRecorder(tmp_path)
    keep = recorder.begin(HEAD)
    assert recorder.news() is None
    monkeypatch.setattr(wire_recorder, "LEAST_FREE", 1 << 60)
    keep(ROWS[0])
    recorder.write()
    assert "the record needs them" in (recorder.news() or "")
    assert recorder.news() is None
    assert recorder.trouble is not None


def test_rows_that_wait_for_too_long_end_the_capture(tmp_path: Path) -> None:
    recorder = WireRecorder(tmp_path)
    keep = recorder.begin(HEAD)
    recorder.write()
    for _ in range(wire_recorder.MOST_ROWS):
        keep(ROWS[0])
    recorder.write()
    assert "too slow" in (recorder.trouble or "")
    recorder.close()
    seal_capture(tmp_path)
    assert list(captured_rows(tmp_path, HEAD.station)) == []


def test_the_thread_writes_every_so_often_and_at_the_end(tmp_path: Path) -> None:
    recorder = WireRecorder(tmp_path)
    keep = recorder.begin(HEAD)
    recorder.start()
    for row in ROWS:
        keep(row)
    recorder.close()
    assert recorder.trouble is None
    seal_capture(tmp_path)
    assert list(captured_rows(tmp_path, HEAD.station)) == ROWS


def test_times_are_those_of_the_run(segment: Path) -> None:
    rows = pa.concat_tables(rows_of_segment(segment))
    times = rows["time"].cast("int64").to_pylist()
    for at_s, time in zip(rows["at_s"].to_pylist(), times, strict=True):
        seconds = at_s - HEAD.t0_mono + HEAD.t0_utc
        assert math.isclose(time / 1e6, seconds, abs_tol=1e-6)
