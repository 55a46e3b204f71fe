"""Damaged parts: each kind of damage is one sentence with the file, and never wrong rows."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.analysis.run import open_run
from jbclog.analysis.run_tables import select
from jbclog.core.errors import RecordError
from jbclog.core.files import NotReadable
from jbclog.record import part_file
from jbclog.record.check import check
from jbclog.record.manifest import SealedFile, manifest_text, read_manifest
from jbclog.record.part_file import PartFile, open_part, read_footer, sealed_footer
from jbclog.record.part_writer import LEAST_A_GROUP
from jbclog.record.parts import part_paths
from support.invoked import invoked
from support.records import sealed_run, small_run

RELEASE = Path(__file__).parents[2] / "data" / "releases" / "0.1.0" / "sealed"
ROWS_OF_A_PORT = LEAST_A_GROUP
ROWS = 2 * ROWS_OF_A_PORT


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose samples have two row groups, of a port each."""
    ports = (1, 2)
    rows = sealed_run.table(*(sealed_run.samples(ROWS_OF_A_PORT, port=port) for port in ports))
    station = sealed_run.station(ports=ports, rows=ROWS_OF_A_PORT)
    return sealed_run.seal(tmp_path_factory.mktemp("made"), [station], rows)


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / made.name))


@pytest.fixture
def old_run(tmp_path: Path) -> Path:
    """A run of 0.1.0, whose manifest has no footers."""
    (folder,) = RELEASE.iterdir()
    return Path(shutil.copytree(folder, tmp_path / folder.name))


def part_of(run: Path) -> Path:
    (part,) = part_paths(run, "samples")
    return part


def seal_of(run: Path) -> SealedFile:
    files = read_manifest(run).files
    return next(file for file in files if file.path == "samples/part-0000.parquet")


def flip(path: Path, place: int) -> None:
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size - 100)


def replace_by_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def replace_by_link(path: Path) -> None:
    moved = path.rename(path.parents[2] / "moved.parquet")
    path.symlink_to(moved)


def add_part(path: Path) -> None:
    shutil.copy(path, path.with_name("part-0001.parquet"))


DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "cut off": (cut, r"has \d+ bytes, the manifest says \d+, so samples are not shown"),
    "empty": (lambda path: path.write_bytes(b""), "has 0 bytes, the manifest says"),
    "footer": (lambda path: flip(path, -300), "was changed: .*is not the manifest's"),
    "end": (lambda path: flip(path, -1), "was changed: .*is not the manifest's"),
    "missing": (lambda path: path.unlink(), "is missing, so samples are not shown"),
    "folder": (lambda path: (path.unlink(), path.mkdir()), "is a folder, not a file"),
    "pipe": (replace_by_pipe, "is a pipe, not a file"),
    "link": (replace_by_link, "is a link, not a file"),
    "not listed": (add_part, "part-0001.parquet is not in the manifest"),
}


@pytest.mark.parametrize("kind", ["run", "old_run"])
@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_one_sentence_with_the_file(
    kind: str, damage: str, request: pytest.FixtureRequest
) -> None:
    run: Path = request.getfixturevalue(kind)
    damaging, sentence = DAMAGE[damage]
    damaging(part_of(run))
    with pytest.raises(RecordError, match=sentence) as raised:
        open_run(run).samples()
    assert str(raised.value).startswith(f"{run}/samples/part-000")
    ended = invoked("export", run, "--to", "csv", "--out", run.parent / "out", "--unchecked")
    assert (ended.exit_code, len(ended.stderr.splitlines())) == (4, 1), ended.stderr
    assert check(run) != []


def test_no_flipped_bit_of_a_footer_reaches_the_library(run: Path) -> None:
    data, seal = part_of(run).read_bytes(), seal_of(run)
    assert seal.footer_bytes is not None
    assert sealed_footer(part_of(run), io.BytesIO(data), seal) == data[-seal.footer_bytes :]
    for place in range(len(data) - seal.footer_bytes, len(data)):
        altered = bytearray(data)
        altered[place] ^= 1 << place % 8
        with pytest.raises(NotReadable, match="was changed"):
            sealed_footer(part_of(run), io.BytesIO(altered), seal)


def test_a_flipped_bit_of_a_page_is_an_error_or_changes_nothing(tmp_path: Path) -> None:
    run = small_run.make_run(tmp_path, seconds=5)
    part, seal = part_of(run), seal_of(run)
    data, rows = part.read_bytes(), pq.read_table(part)
    assert seal.footer_bytes is not None
    refused = 0
    for place in range(0, len(data) - seal.footer_bytes, 3):
        altered = bytearray(data)
        altered[place] ^= 1 << place % 8
        part.write_bytes(altered)
        try:
            with open_part(part, seal) as opened:
                assert pa.concat_tables(opened.groups()).equals(rows), place
        except RecordError:
            refused += 1
    assert refused > len(range(0, len(data) - seal.footer_bytes, 3)) // 2


def test_the_library_gets_the_bytes_that_were_compared(run: Path) -> None:
    with part_of(run).open("rb") as file:
        footer = read_footer(file)
    rows = pq.read_table(part_of(run))
    with part_of(run).open("r+b") as file:
        file.seek(-len(footer), os.SEEK_END)
        file.write(bytes(len(footer)))
    part = PartFile(str(part_of(run)), footer, "part")
    assert pa.concat_tables(part.groups()).equals(rows)


def test_only_a_run_without_footers_is_hashed_whole(
    run: Path, old_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole: list[Path] = []
    monkeypatch.setattr(
        part_file, "_whole_sha256", lambda path, *_: whole.append(path) or seal_of(old_run).sha256
    )
    assert len(open_run(run).samples()) == ROWS
    assert whole == []
    assert len(open_run(old_run).samples()) > 0
    assert {*whole} == {part_of(old_run)}


def test_a_changed_page_of_a_run_without_footers_is_refused(old_run: Path) -> None:
    flip(part_of(old_run), 100)
    with pytest.raises(RecordError, match="was changed: its SHA-256 is not the manifest's"):
        open_run(old_run).samples()


def test_the_manifest_has_the_footers_of_all_parts_and_of_nothing_else(run: Path) -> None:
    for file in read_manifest(run).files:
        if not file.path.endswith(".parquet"):
            assert (file.footer_bytes, file.footer_sha256) == (None, None)
            continue
        data = (run / file.path).read_bytes()
        assert file.footer_bytes == int.from_bytes(data[-8:-4], "little") + 8
        assert file.footer_sha256 == hashlib.sha256(data[-file.footer_bytes :]).hexdigest()


def damage_second_group(run: Path) -> None:
    with part_of(run).open("rb") as file:
        column = pq.ParquetFile(file).metadata.row_group(1).column(8)
    flip(part_of(run), column.data_page_offset + column.total_compressed_size // 2)


def test_an_unchecked_export_has_the_sound_row_groups(run: Path, tmp_path: Path) -> None:
    damage_second_group(run)
    (found,) = [one for one in check(run) if "cannot be read" in one.text]
    assert found.file == "samples/part-0000.parquet"
    with pytest.raises(RecordError, match=r"part-0000\.parquet, row group 1: "):
        open_run(run).samples()
    assert invoked("export", run, "--to", "csv", "--out", tmp_path / "out").exit_code == 4
    words = ("--to", "csv", "--table", "samples", "--out", tmp_path / "out", "--unchecked")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        ended = invoked("export", run, *words)
    assert ended.exit_code == 0, ended.output
    (warning,) = [line for line in ended.stderr.splitlines() if "left out" in line]
    assert "part-0000.parquet, row group 1: " in warning
    lines = (tmp_path / "out" / "samples.csv").read_text().splitlines()
    assert len([line for line in lines if not line.startswith("#")]) == ROWS_OF_A_PORT + 1


@pytest.mark.parametrize("is_sealed", [True, False])
def test_a_part_beside_the_times_is_not_read(run: Path, is_sealed: bool) -> None:
    """Nor is one of a run that is not sealed, whose footers nothing vouches for."""
    seal = seal_of(run) if is_sealed else None
    rows = open_run(run).samples(columns=["time"])["time"]
    for start, stop, is_in in (
        (rows.iloc[-1], None, True),
        (rows.iloc[-1] + pd.Timedelta("1us"), None, False),
        (None, rows.iloc[0] + pd.Timedelta("1us"), True),
        (None, rows.iloc[0], False),
    ):
        assert select("samples", start=start, stop=stop).may_have(part_of(run), seal) is is_in


def test_a_manifest_of_0_1_0_reads_as_it_was_written(old_run: Path) -> None:
    files = json.loads((old_run / "manifest.json").read_text())["files"]
    assert all("footer_bytes" not in file for file in files)
    manifest = read_manifest(old_run)
    assert {file.footer_bytes for file in manifest.files} == {None}
    assert '"footer_bytes": null' in manifest_text(replace(manifest))
