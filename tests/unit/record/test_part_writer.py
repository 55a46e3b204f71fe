"""Parts: every row once, samples by station, port and tick, a row group a port; and the rows of a
port read from them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jbclog.core.errors import RecordError
from jbclog.record import part_file, part_writer, row_batches
from jbclog.record.manifest import SealedFile
from jbclog.record.part_writer import WrittenPart, collected, write_part
from jbclog.record.parts import groups_of
from jbclog.record.samples_by_port import samples_by_port
from jbclog.record.schema import SCHEMAS
from support.records.few_rows import with_cell

COLUMNS = ["seq", "time", "tick", "reasons"]
LEAST, MOST = 4, 9
Key = tuple[str, int, int]
"""Station, port and tick of a row."""


def samples(keys: Sequence[Key]) -> pa.Table:
    """Samples in the order in which they were recorded."""
    rows = [
        {
            "run": "r",
            "seq": seq,
            "time": 1_790_000_000_000_000 + 1000 * seq,
            "tick": tick,
            "station": station,
            "port": port,
            "quality": "ok",
            "reasons": None if seq % 3 else f"tool=nak{seq}",
            "temperature_c": 300 + tick,
        }
        for seq, (station, port, tick) in enumerate(keys)
    ]
    return pa.Table.from_pylist(rows, SCHEMAS["samples"])


def seals_of(part: WrittenPart) -> dict[Path, SealedFile]:
    name = f"samples/{part.path.name}"
    footer = (part.footer_bytes, part.footer_sha256)
    return {part.path: SealedFile(name, part.rows, part.bytes, part.sha256, *footer)}


def seqs(rows: pa.Table) -> list[int]:
    return list(rows["seq"].to_pylist())


KEYS = st.tuples(st.sampled_from(["b", "a", "\u00e4", "B"]), st.integers(1, 3), st.integers(0, 5))


@settings(max_examples=60, deadline=None)
@given(st.lists(KEYS, max_size=60), st.integers(1, 20))
def test_samples_are_sorted_and_a_port_is_found(keys: list[Key], rows_a_piece: int) -> None:
    with pytest.MonkeyPatch.context() as patched, TemporaryDirectory() as home:
        patched.setattr(part_writer, "LEAST_A_GROUP", LEAST)
        patched.setattr(part_writer, "MOST_A_GROUP", MOST)
        patched.setattr(row_batches, "ROWS_AT_ONCE", 7)
        recorded = samples(keys)
        pieces = [recorded[at : at + rows_a_piece] for at in range(0, len(keys), rows_a_piece)]
        part = write_part(Path(home), "samples", collected("samples", pieces), 0)

        rows = pq.ParquetFile(part.path).read()
        in_order = sorted(range(len(keys)), key=keys.__getitem__)  # stable
        assert rows.equals(recorded.take(pa.array(in_order, pa.int64())))
        groups = [*groups_of([part.path], ["station", "port"])]
        expect_groups([pairs(group) for group in groups])
        for seals in (seals_of(part), {}):
            by_port = samples_by_port(Path(home), COLUMNS, seals=seals)
            assert by_port.ports == sorted({key[:2] for key in keys})
            for key in by_port.ports:
                assert [seq for rows in by_port.rows(key) for seq in seqs(rows)] == [
                    seq for seq in in_order if keys[seq][:2] == key
                ]


def pairs(rows: pa.Table) -> list[tuple[str, int]]:
    return list(zip(rows["station"].to_pylist(), rows["port"].to_pylist(), strict=True))


def expect_groups(groups: list[list[tuple[str, int]]]) -> None:
    """A port with enough rows is alone; others share a group until it has enough."""
    counts: dict[tuple[str, int], int] = {}
    for group in groups:
        assert 0 < len(group) <= MOST
        for key in group:
            counts[key] = counts.get(key, 0) + 1
    for group in groups:
        ports = dict.fromkeys(group)
        if len(ports) > 1:
            assert all(counts[key] < LEAST for key in ports)
            assert sum(counts[key] for key in [*ports][:-1]) < LEAST


def test_only_the_row_groups_of_a_port_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(part_writer, "LEAST_A_GROUP", LEAST)
    ports = [(station, port) for station in ("a", "b") for port in (1, 2, 3)]
    part = write_part(
        tmp_path, "samples", samples([(*key, n) for n in range(5) for key in ports]), 0
    )
    read: list[int] = []
    group = part_file.PartFile.group

    def noted(part: part_file.PartFile, index: int, columns: Sequence[str] | None) -> pa.Table:
        read.append(index)
        return group(part, index, columns)

    monkeypatch.setattr(part_file.PartFile, "group", noted)
    (rows,) = samples_by_port(tmp_path, ["tick"], seals=seals_of(part)).rows(("b", 2))
    assert (read, rows["tick"].to_pylist()) == ([4], [0, 1, 2, 3, 4])


def test_rows_of_a_port_in_a_part_as_recorded(tmp_path: Path) -> None:
    """As parts of 0.1.0 are."""
    ports = [("b", 1), ("a", 1), ("a", 2)]
    recorded = samples([(*key, tick) for tick in range(9) for key in ports])
    path = tmp_path / "samples" / "part-0000.parquet"
    path.parent.mkdir()
    pq.write_table(recorded, path, row_group_size=10)
    by_port = samples_by_port(tmp_path, ["tick"], [recorded.slice(25)], [("b", 1), ("c", 7)])
    assert by_port.ports == [("b", 1), ("c", 7), ("a", 1), ("a", 2)]
    rows = [*by_port.rows(("a", 1))]
    ticks = [tick for some in rows for tick in some["tick"].to_pylist()]
    assert ticks == [*range(9), 8]
    assert [*by_port.rows(("c", 7))] == []


def test_row_groups_of_several_ports_are_kept_up_to_a_number_of_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("jbclog.record.samples_by_port.MOST_KEPT", 0)
    keys = [(station, 1, tick) for station in ("a", "b") for tick in range(3)]
    write_part(tmp_path, "samples", samples(keys), 0)
    by_port = samples_by_port(tmp_path, COLUMNS)
    for _ in range(2):
        found = [seq for key in by_port.ports for rows in by_port.rows(key) for seq in seqs(rows)]
        assert found == [*range(6)]


def test_the_other_tables_stay_in_the_order_of_seq(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(part_writer, "ROWS_A_GROUP", 4)
    row = {"run": "r", "time": 0, "station": "a", "port": 1, "counter": "c", "value": 1.0}
    row |= {"uom": "h", "raw": "1"}
    rows = [row | {"seq": seq, "station": "ba"[seq % 2]} for seq in range(5, 15)]
    recorded = pa.Table.from_pylist(rows, SCHEMAS["counters"])
    part = write_part(tmp_path, "counters", recorded, 0)
    assert pq.ParquetFile(part.path).read().equals(recorded)
    assert [len(group) for group in groups_of([part.path])] == [4, 4, 2]
    assert (part.rows, part.first_seq, part.last_seq) == (10, 5, 14)


def test_long_texts_are_in_small_groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(part_writer, "BYTES_A_GROUP", 1000)
    row = {"run": "r", "seq": 0, "time": 0, "station": "a", "port": 1, "counter": "c"}
    rows = [row | {"value": 1.0, "uom": "h", "raw": "x" * 400} for _ in range(10)]
    part = write_part(tmp_path, "counters", pa.Table.from_pylist(rows, SCHEMAS["counters"]), 0)
    assert max(len(group) for group in groups_of([part.path])) <= 3


def test_what_is_said_of_a_part(tmp_path: Path) -> None:
    part = write_part(tmp_path, "samples", samples([("a", 2, 0), ("a", 1, 0)]).slice(1), 0)
    data = part.path.read_bytes()
    assert part.path == tmp_path / "samples" / "part-0000.parquet"
    assert (part.rows, part.first_seq, part.last_seq) == (1, 1, 1)
    assert (part.bytes, part.sha256) == (len(data), hashlib.sha256(data).hexdigest())
    assert part.footer_bytes == int.from_bytes(data[-8:-4], "little") + 8
    assert part.footer_sha256 == hashlib.sha256(data[-part.footer_bytes :]).hexdigest()
    empty = write_part(tmp_path, "samples", samples([]), 1)
    assert (empty.path.name, empty.rows) == ("part-0001.parquet", 0)
    assert (empty.first_seq, empty.last_seq) == (None, None)


def test_encodings_that_every_reader_knows(tmp_path: Path) -> None:
    """Readers of formats before 2.11 know no BYTE_STREAM_SPLIT of integers."""
    part = write_part(tmp_path, "samples", samples([("a", 1, tick) for tick in range(50)]), 0)
    group = pq.read_metadata(part.path).row_group(0)
    columns = [group.column(place) for place in range(group.num_columns)]
    encodings = {column.path_in_schema: set(column.encodings) for column in columns}
    for name in ("time", "tick", "seq", "temperature_c"):
        assert "DELTA_BINARY_PACKED" in encodings[name], name
    for name in ("run", "station", "quality", "late_us"):
        assert "RLE_DICTIONARY" in encodings[name], name
    assert not any("BYTE_STREAM_SPLIT" in some for some in encodings.values())
    assert {column.compression for column in columns} == {"ZSTD"}
    assert all(column.statistics is not None for column in columns)


def test_what_reads_back_differently_is_not_a_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    group = part_file.PartFile.group
    monkeypatch.setattr(
        part_file.PartFile,
        "group",
        lambda self, index: with_cell(group(self, index), 0, "temperature_c", 1),
    )
    with pytest.raises(RecordError, match="not what was written"):
        write_part(tmp_path, "samples", samples([("a", 1, 0), ("a", 1, 1)]), 0)
    assert list((tmp_path / "samples").iterdir()) == []
