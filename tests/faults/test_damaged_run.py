"""Any file of a run altered: `check` names it, nothing shows a wrong value, and the next run in the
same place starts.

docs/reference/faults.md, F-29, F-30 and F-44. Sealed runs and runs that a crash left open, file by
file; the printed line is the one in the table.
"""

from __future__ import annotations

import gc
import shutil
import warnings
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import pandas as pd
import pytest

from jbclog.analysis.run import open_run
from jbclog.core.errors import RecordError
from jbclog.core.locks import is_held
from jbclog.core.rows import TABLES
from jbclog.guard.open_leases import settle
from jbclog.record.chains import previous_run
from jbclog.record.check import check
from jbclog.record.conclude import live_files
from jbclog.record.folder import create_run
from jbclog.record.manifest import NAME, read_manifest, write_manifest
from jbclog.record.part_chain import NAME as PART_LIST
from jbclog.record.part_chain import PartChain
from jbclog.record.recover import Outcome, recover, recover_all
from jbclog.record.seal import seal_journal
from jbclog.record.wire import WHOLE, seal_capture
from jbclog.report.write import report_files
from support.faults.altered_files import (
    Altered,
    Count,
    bits_flipped,
    bytes_replaced,
    percents_cut_off,
    pieces_moved,
    sectors_zeroed,
)
from support.links.small_wire import HEAD, write_wire
from support.records import few_rows
from support.records.small_run import make_run

Shown = dict[str, pd.DataFrame | str]
STATION = HEAD.station


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small sealed run with a serial capture."""
    folder = make_run(tmp_path_factory.mktemp("runs"), seconds=2.0)
    write_wire(folder)
    seal_capture(folder)
    manifest = read_manifest(folder)
    manifest.files += [part.file for part in PartChain(folder).of("wire")]
    manifest.wire = WHOLE
    write_manifest(folder, manifest)
    (folder / PART_LIST).unlink()
    assert check(folder) == []
    return folder


@pytest.fixture(scope="module")
def report(sealed: Path) -> dict[str, bytes]:
    return report_files(sealed)


# -- shown values ----------------------------------------------------------------------------------


def shown(folder: Path) -> Shown:
    """Return everything that `open_run` gives, table by table, without tables that say they cannot
    be shown.
    """
    found: Shown = {}
    try:
        run = open_run(folder)
        found["manifest"] = str(run.manifest)
    except RecordError:
        return found
    tables: dict[str, Callable[[], pd.DataFrame]] = {
        "samples": run.samples,
        "events": run.events,
        "settings": run.settings,
        "counters": run.counters,
        "wire": lambda: run.wire(STATION),
    }
    for name, table in tables.items():
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a warning says that something is missing
            try:
                found[name] = table()
            except (RecordError, UserWarning):
                continue
    return found


@pytest.fixture(scope="module")
def whole(sealed: Path) -> Shown:
    return shown(sealed)


def is_wrong(found: Shown, whole: Shown) -> bool:
    """Whether anything is shown that differs from the record."""
    return any(not _same(found[name], whole[name]) for name in found)


def _same(one: pd.DataFrame | str, other: pd.DataFrame | str) -> bool:
    return (
        one.equals(other)
        if isinstance(one, pd.DataFrame) and isinstance(other, pd.DataFrame)
        else one == other
    )


def named(folder: Path, name: str) -> bool:
    """Whether `check` names the file."""
    try:
        return any(finding.file == name for finding in check(folder))
    except RecordError as error:
        return name in str(error)


def assert_next_run_begins(out: Path) -> None:
    """The steps of a start that concern the runs already there."""
    settle(out, {"dde-1.pty"}, is_held)
    previous_run(out, "bench")
    assert create_run(out, "bench", 1_790_000_500.0).is_dir()


def report_is_wrong(folder: Path, whole: dict[str, bytes]) -> bool:
    try:
        return report_files(folder) != whole
    except RecordError:
        return False


# -- a sealed run ----------------------------------------------------------------------------------


def alterations(data: bytes, long: bool) -> Iterator[Altered]:
    """Bits and bytes at each percent, sectors of zeros, pieces lost and doubled."""
    stride = max(len(data) // (150 if long else 2), 1)
    yield from percents_cut_off(data, 1 if long else 50)
    yield from bits_flipped(data, 8 * stride + 3)
    yield from islice(bytes_replaced(data, 2 * stride + 1), None if long else 1)
    yield from sectors_zeroed(data, 512 if long else len(data))
    yield from pieces_moved(data, 16 * stride if long else len(data))


def walk(
    sealed: Path, whole: Shown, report: dict[str, bytes], home: Path, name: str, long: bool
) -> Count:
    """Alter one file of a sealed run in every way, and examine everything."""
    trial = home / "runs" / sealed.name
    shutil.copytree(sealed, trial)
    data, count = (path := trial / name).read_bytes(), Count(f"sealed run, {name} altered")
    for number, one in enumerate(alterations(data, long)):
        if one.data == data:
            continue
        path.write_bytes(one.data)
        found = shown(trial)
        wrong = is_wrong(found, whole) or (
            number % 40 == 2 and (long or name not in UNSHOWN) and report_is_wrong(trial, report)
        )
        assert named(trial, name), one.how
        assert not wrong, one.how
        count.add(lost=len(found) < len(whole), wrong=wrong)
    path.write_bytes(data)
    assert_next_run_begins(home / "runs")
    print(count.told())
    gc.collect()
    return count


UNSHOWN = ("line.toml", "recipes/tht.toml", "wire/part-0000.parquet")  # not in a report
FILES = (
    *(f"{table}/part-0000.parquet" for table in TABLES),
    NAME,
    "wire/part-0000.parquet",
    "line.toml",
    "recipes/tht.toml",
)


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_a_sealed_run_altered_in_places(
    sealed: Path, whole: Shown, report: dict[str, bytes], tmp_path: Path, name: str
) -> None:
    assert walk(sealed, whole, report, tmp_path, name, long=False).wrong == 0


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", FILES)
def test_a_file_of_a_sealed_run_altered_everywhere(
    sealed: Path,
    whole: Shown,
    report: dict[str, bytes],
    tmp_path: Path,
    name: str,
    counted: Callable[..., None],
) -> None:
    count = walk(sealed, whole, report, tmp_path, name, long=True)
    assert count.wrong == 0
    counted(alterations=count.tried, wrong=count.wrong)


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_a_sealed_run_that_is_gone(
    sealed: Path, whole: Shown, tmp_path: Path, name: str
) -> None:
    trial = tmp_path / sealed.name
    shutil.copytree(sealed, trial)
    (trial / name).unlink()
    assert not is_wrong(shown(trial), whole)
    assert named(trial, name) or name == NAME
    assert_next_run_begins(tmp_path)


def test_recover_says_of_a_sealed_run_that_it_cannot_rebuild_it(
    sealed: Path, tmp_path: Path
) -> None:
    trial = tmp_path / sealed.name
    shutil.copytree(sealed, trial)
    (trial / "samples" / "part-0000.parquet").write_bytes(b"")
    done = recover(trial)
    assert done.outcome is Outcome.WHOLE
    assert (
        "But samples/part-0000.parquet was changed after it was sealed. No journal is left to"
        " rebuild it from" in done.text
    )
    assert recover(sealed).text == f"{sealed.name}: already finished; nothing was changed."


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{",
        b"[" * 100_000,
        b"null",
        b'{"run": 5}',
        b"\xff\xfe",
        b'{"schema": 2}',
        b"\0" * 4096,
    ],
)
def test_a_manifest_that_is_none_stops_nothing(sealed: Path, tmp_path: Path, data: bytes) -> None:
    trial = tmp_path / sealed.name
    shutil.copytree(sealed, trial)
    (trial / NAME).write_bytes(data)
    assert shown(trial) == {}
    assert named(trial, NAME)
    (done,) = recover_all(trial)
    assert done.outcome is Outcome.REFUSED
    assert NAME in done.text
    assert_next_run_begins(tmp_path)


def test_a_ledger_that_was_altered_is_named(sealed: Path, tmp_path: Path) -> None:
    """Every number of it, with a recomputed digest: it contradicts the tables."""
    trial = tmp_path / sealed.name
    shutil.copytree(sealed, trial)
    count = Count("sealed run, a number of the ledger altered")
    manifest = read_manifest(trial)
    for ports in manifest.ledger.values():
        for signals in ports.values():
            for readings in signals.values():
                for name in sorted(readings)[:1]:
                    readings[name] += 1
                    write_manifest(trial, manifest)
                    assert any("ledger" in finding.text for finding in check(trial)), name
                    count.add()
                    readings[name] -= 1
    print(count.told())


# -- a run that a crash left open ------------------------------------------------------------------


@pytest.fixture(scope="module")
def half_sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A crash in mid-sealing: all rows are in parts, and still in the journal."""
    folder = few_rows.abandoned(tmp_path_factory.mktemp("runs"), commits=3, rows=10)
    seal_journal(folder)
    return folder


def open_trial(half_sealed: Path, home: Path, name: str, one: Altered) -> Path:
    trial = home / half_sealed.name
    shutil.rmtree(trial, ignore_errors=True)
    shutil.copytree(half_sealed, trial)
    (trial / name).write_bytes(one.data)
    return trial


def rebuilt(half_sealed: Path, home: Path, name: str, long: bool) -> Count:
    """A part altered, then recovered: the rows come from the journal, unchanged."""
    data, count = (
        (half_sealed / name).read_bytes(),
        Count(f"half sealed run, {name} altered, then recovered"),
    )
    stride = max(len(data) // (60 if long else 2), 1)
    ways = (
        percents_cut_off(data, 1 if long else 50),
        bits_flipped(data, 8 * stride + 5),
        sectors_zeroed(data, 512 if long else len(data)),
    )
    for one in (one for way in ways for one in way):
        trial = open_trial(half_sealed, home, name, one)
        recover(trial)
        numbers = few_rows.sealed_numbers(trial)  # each row is as written
        events = few_rows.sealed_events(trial)
        assert (numbers, events) == (list(range(30)), list(range(0, 30, 7))), one.how
        assert check(trial) == [], one.how
        count.add()
    print(count.told())
    return count


@pytest.mark.parametrize("place", ["cut", "footer", "gone"])
def test_a_part_damaged_between_sealing_and_the_removal_of_the_journal(
    half_sealed: Path, tmp_path: Path, place: str
) -> None:
    """A power loss at the very end: the manifest says sealed, the journal is there, and a part
    never reached the disk.
    """
    trial = tmp_path / half_sealed.name
    shutil.copytree(half_sealed, trial)
    live = {path: path.read_bytes() for path in live_files(trial)}
    recover(trial)
    for path, kept in live.items():
        path.write_bytes(kept)
    part = trial / "samples" / "part-0000.parquet"
    data = bytearray(part.read_bytes())
    data[-40] ^= 4
    part.write_bytes(b"" if place == "cut" else data)
    if place == "gone":
        part.unlink()
    done = recover(trial)
    assert done.outcome is Outcome.RECOVERED
    assert few_rows.sealed_numbers(trial) == list(range(30))
    assert check(trial) == []
    assert "samples/part-0000.parquet" in done.text
    assert recover(trial).outcome is Outcome.WHOLE


PARTS = [f"{table}/part-0000.parquet" for table in ("samples", "events")]


@pytest.mark.parametrize("name", PARTS)
def test_a_damaged_part_is_rebuilt_from_the_journal(
    half_sealed: Path, tmp_path: Path, name: str
) -> None:
    assert rebuilt(half_sealed, tmp_path, name, long=False).lost == 0


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", PARTS)
def test_a_part_damaged_everywhere_is_rebuilt_from_the_journal(
    half_sealed: Path, tmp_path: Path, name: str, counted: Callable[..., None]
) -> None:
    count = rebuilt(half_sealed, tmp_path, name, long=True)
    assert count.lost == 0
    counted(alterations=count.tried, rows_lost=count.lost, wrong=count.wrong)
