"""Live stores larger than a recorder's: read in bounded memory or refused, never sealed into
something that jbclog does not read.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pytest

import jbclog
from jbclog.core.errors import RecordError
from jbclog.core.foreign.tables import metadata_of
from jbclog.record import parts, seal, store, store_reader
from jbclog.record.batches import MOST_ROWS, encode
from jbclog.record.check import check
from jbclog.record.parts import ROWS_A_GROUP, part_paths, regroup, write_part
from jbclog.record.recover import Outcome, recover, recover_all
from jbclog.record.schema import SCHEMAS
from jbclog.record.store import META
from jbclog.record.store_reader import MOST_DAMAGE, StoreReader
from jbclog.report.write import write_report
from support.campaigns.foreign_matrix import Pairs
from support.faults.large_stores import crashed_run, large_batches, packed, samples, small_batches
from support.records import few_rows
from support.records.small_run import make_run


def test_a_batch_larger_than_any_recorder_s_is_one_finding_and_blocks_no_other_run(
    tmp_path: Path, pairs: Pairs
) -> None:
    bad = crashed_run(tmp_path, large_batches(2, MOST_ROWS + 1))
    make_run(tmp_path, 5.0)
    for words in (
        ["trend", str(tmp_path)],
        ["chart", str(tmp_path), "--metric", "alarms"],
        ["alarms", str(bad)],
    ):
        ended = pairs.run(words)
        assert ended.trouble is None, ended
        lines = [
            line
            for line in ended.output.splitlines()
            if bad.name in line and "no alarms" not in line
        ]
        assert len(lines) == 1, ended.output
        assert f"a recorder's batches have at most {MOST_ROWS}" in lines[0]
        assert "`jbclog recover`" in lines[0]
    assert "dde-1 port 1" in pairs.run(["trend", str(tmp_path)]).output


def test_a_run_whose_tables_cannot_be_read_is_a_finding_in_its_place(
    tmp_path: Path, pairs: Pairs
) -> None:
    bad, good = make_run(tmp_path / "bad", 5.0), make_run(tmp_path / "good", 5.0)
    good, bad = good.rename(tmp_path / "good.run"), bad.rename(tmp_path / "bad.run")
    part = bad / "samples" / "part-0000.parquet"
    part.write_bytes(part.read_bytes()[:-1] + b"X")
    runs = jbclog.open_runs(tmp_path)
    assert [one.folder for one, _ in runs.metric_rows()] == [good]
    assert [(one.folder, "part-0000.parquet" in one.why) for one in runs.unreadable] == [
        (bad, True)
    ]
    for words in (["trend", str(tmp_path)], ["chart", str(tmp_path), "--metric", "alarms"]):
        ended = pairs.run(words)
        assert (ended.trouble, ended.output.count("part-0000.parquet")) == (None, 1), ended


def test_what_recover_seals_jbclog_reads_in_little_memory(tmp_path: Path, pairs: Pairs) -> None:
    folder = crashed_run(tmp_path, large_batches(3, 230_000))
    ended = pairs.run(["recover", str(tmp_path)])
    assert (ended.trouble, "690000 samples" in ended.output) == (None, True), ended
    groups = [
        metadata_of(path).row_group(n).num_rows
        for path in part_paths(folder, "samples")
        for n in range(metadata_of(path).num_row_groups)
    ]
    assert max(groups) < 2 * ROWS_A_GROUP
    assert pairs.run(["check", str(folder)]).trouble is None


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("count", [7, 25, 100])
def test_memory_does_not_grow_with_the_store(
    tmp_path: Path, pairs: Pairs, count: int, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = crashed_run(tmp_path, large_batches(count, 230_000))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = sum(len(piece) for piece in jbclog.open_run(folder).stream(columns=["tick"]))
    ended = [
        pairs.run(["recover", str(tmp_path)], limited=False),
        pairs.run(["check", str(folder)], limited=False),
    ]
    with capsys.disabled():
        print(f"\n{rows} rows:", *(f"{one.seconds:.1f} s, {one.peak_mb} MB" for one in ended))
    assert [one.trouble for one in ended] == [None, None]


def test_a_group_that_would_be_refused_is_not_written(tmp_path: Path) -> None:
    rows = pa.Table.from_batches([samples(MOST_ROWS + 1)]).cast(SCHEMAS["samples"])
    with pytest.raises(RecordError, match="would not be read again"):
        write_part(tmp_path, "samples", lambda: [rows], 1)
    assert part_paths(tmp_path, "samples") == []
    assert list((tmp_path / "samples").iterdir()) == []


def test_groups_are_small_in_bytes_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "BYTES_A_GROUP", 1000)
    assert [len(group) for group in regroup([pa.table({"x": ["x" * 600]})] * 5)] == [2, 2, 1]


def test_many_batches_become_several_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seal, "ROWS_A_PART", 4)
    folder = crashed_run(tmp_path, small_batches(range(1, 11)))
    recover(folder)
    assert [metadata_of(path).num_rows for path in part_paths(folder, "samples")] == [4, 4, 2]
    assert check(folder) == []


VALUES = {
    "a time that no calendar has": (
        "time",
        pa.array([2**62], pa.int64()).cast(pa.timestamp("us", tz="UTC")),
    ),
    "a number beyond all": ("tick", pa.array([2**63 - 1], pa.int64())),
    "no station": ("station", pa.nulls(1, pa.utf8())),
    "a text that is none": ("status", pa.array([b"\xff\xfe"]).view(pa.utf8())),
}


@pytest.mark.parametrize("what", VALUES)
def test_values_that_a_part_may_not_hold_are_damage_in_the_store(tmp_path: Path, what: str) -> None:
    name, value = VALUES[what]
    rows = samples(1)
    wrong = pa.RecordBatch.from_arrays(
        [value if n == name else rows[n] for n in rows.schema.names], schema=rows.schema
    )
    folder = crashed_run(tmp_path, [packed(1, "samples", samples(3)), packed(2, "samples", wrong)])
    assert recover(folder).outcome is Outcome.RECOVERED
    assert len(few_rows.table(folder, "samples")) == 3
    assert [one.place for one in parts.read_damage(folder)] == ["batch 2 (samples)"]
    assert check(folder) == []


def test_few_of_many_damages_are_listed(tmp_path: Path) -> None:
    folder = crashed_run(tmp_path, small_batches(range(1, 300, 2)))
    with StoreReader(folder) as stock:
        assert len(stock.damage) == MOST_DAMAGE + 1
        assert "the others are not listed" in str(stock.damage[-1])
    done = recover_all(folder)[0]
    assert len(done.text) < 1000
    assert check(folder) == []


@pytest.mark.parametrize("text", ["²", "9" * 400, str(2**63), "9" * 18])
def test_a_note_that_is_no_number_of_a_batch(tmp_path: Path, text: str) -> None:
    folder = crashed_run(
        tmp_path,
        small_batches([1]),
        {(META, "last"): text, (META, "dropped"): text, (META, "sealed"): "²"},
    )
    assert recover_all(folder)[0].outcome is Outcome.RECOVERED


def test_more_notes_or_batches_than_a_store_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "MOST_NOTES_BYTES", 2 << 20)
    monkeypatch.setattr(store, "MOST_BATCHES", 3)
    folder = crashed_run(tmp_path, small_batches(range(1, 6)), {("facts", "b"): " " * (2 << 20)})
    with StoreReader(folder) as stock:
        assert stock.facts() == {}
        assert any(
            "notes (facts) cannot be read: its notes have more than 2 MiB" in str(one)
            for one in stock.damage
        )
        assert any("more than 3 batches" in str(one) for one in stock.damage)
        assert stock.numbers_of("samples", 0) == [1, 2, 3]


def test_rows_that_take_too_many_bytes_are_several_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    from jbclog.record import batches, live

    told: list[Exception] = []
    buffer = live.RowBuffer("run", lambda _, error: told.append(error))
    for number in range(10):
        buffer.sample(few_rows.sample(number))
    monkeypatch.setattr(live, "ROWS_A_BATCH", 4)
    buffer.take()
    assert [batch.rows for batch in buffer.backlog] == [4, 4, 2]
    monkeypatch.setattr(batches, "MOST_BYTES", len(encode_stream(few_rows.sample(0))) + 100)
    for number in range(10):
        buffer.sample(few_rows.sample(number))
    buffer.take()
    assert sum(batch.rows for batch in buffer.backlog) == 20
    assert told == []


def encode_stream(values: list[object]) -> bytes:
    """A batch of these values, unpacked."""
    made = encode(1, "samples", values)
    return bytes(int.from_bytes(made.data[:4], "little"))


def test_a_live_store_of_many_rows_is_read_in_pieces_and_said_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from jbclog.analysis import run_tables

    folder = crashed_run(tmp_path, large_batches(2, 40_000))
    whole = jbclog.open_run(folder).samples()
    monkeypatch.setattr(run_tables, "HELD_ROWS", 10)
    run = jbclog.open_run(folder)
    with pytest.warns(UserWarning, match="80000 rows in its live store"):
        pieces = [*run.stream()]
    assert max(map(len, pieces)) <= ROWS_A_GROUP
    assert sum(map(len, pieces)) == len(whole) == 80_000
    monkeypatch.setitem(run_tables.MOST_WHOLE, "events", 0)
    assert len(run.samples()) == 80_000
    with pytest.raises(RecordError, match="not read as a whole"):
        jbclog.open_run(make_run(tmp_path, 5.0)).events()
    monkeypatch.setitem(run_tables.MOST_WHOLE, "settings", 0)
    with pytest.raises(RecordError, match="settings take more than 0 MiB"):
        jbclog.open_run(make_run(tmp_path / "other", 5.0)).settings()


def test_a_report_reads_no_counters_as_a_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are read once a minute: those of 32 ports take more than 128 MiB after a week, those of
    250 stations after a day.
    """
    from jbclog.analysis import run_tables

    folder = make_run(tmp_path, 8.0)
    counters = len(jbclog.open_run(folder).counters())
    monkeypatch.setitem(run_tables.MOST_WHOLE, "counters", 300)
    with pytest.raises(RecordError, match="counters take more"):
        jbclog.open_run(folder).counters()
    write_report(folder)
    told = json.loads((folder / "report.json").read_text())
    assert sum(row["readings"] for row in told["counters"]) == counters > 20
    assert len(jbclog.open_run(folder).metrics()) > 20


def test_a_damaged_index_is_probed_no_further_than_the_file_reaches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = crashed_run(tmp_path, small_batches([1]), {(META, "last"): "9" * 18})
    tried: list[int] = []

    def damaged(self: store.Segment) -> Iterator[tuple[int, str, int]]:
        raise store.sqlite3.DatabaseError("damaged")
        yield

    get = store.Segment.get
    monkeypatch.setattr(store.Segment, "index", damaged)
    monkeypatch.setattr(
        store.Segment, "get", lambda self, number: tried.append(number) or get(self, number)
    )
    with StoreReader(folder) as stock:
        assert stock.numbers_of("samples", 0) == [1]
    assert len(tried) <= (folder / "live.sqlite").stat().st_size // store_reader.LEAST_BYTES
