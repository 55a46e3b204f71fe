"""`check` finds what was done to a sealed run afterwards, and what a recorder did wrong before."""

from __future__ import annotations

import errno
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from shutil import copytree

import pyarrow as pa
import pyarrow.compute as pc
import pytest

from jbclog.core.errors import RecordError
from jbclog.record.annotations import append
from jbclog.record.check import check
from jbclog.record.manifest import Lost, Manifest, manifest_sha256, read_manifest, write_manifest
from support.faults.deep_folder import deep_folder
from support.records import few_rows
from support.records.few_rows import rewritten, with_cell
from support.records.listed_files import files_of
from support.records.small_run import make_run


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("runs"), seconds=12.0)


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    return copytree(made, tmp_path / made.name)


def texts(folder: Path) -> list[str]:
    return [str(finding) for finding in check(folder)]


def test_a_run_as_it_was_sealed(run: Path) -> None:
    assert texts(run) == []


def test_what_comes_after_sealing_is_no_finding(run: Path) -> None:
    for name in ("figures", "derived"):
        (run / name).mkdir()
    for name in (
        "report.html",
        "derived/joints.parquet",
        "derived/.units.parquet.tmp",
        "figures/dde-1-1.svg",
    ):
        (run / name).write_text("x")
    (run / "report.json").write_text(json.dumps({"manifest_sha256": manifest_sha256(run)}))
    append(run, who="A. Rossi", what="SN-12 was scrapped", why="cracked joint")
    assert texts(run) == []


def test_an_empty_folder_that_nobody_knows_and_a_lease_that_nobody_closed_are_told(
    run: Path,
) -> None:
    (run / "extra" / "inner").mkdir(parents=True)
    (run / "figures").mkdir()
    assert texts(run) == ["extra/inner/: is not in the manifest"]
    (run / "extra" / "inner").rmdir()
    (run / "lease.json").write_text('{"name": "dde-1", "ports": [1]}\n')
    lease, extra = texts(run)
    assert extra == "extra/: is not in the manifest"
    assert lease == "lease.json: names dde-1 as possibly hot; the manifest does not"
    (run / "lease.json").write_text("")
    assert texts(run)[0] == "lease.json: names no station whose tools may be hot"


def test_folders_in_one_another_are_one_finding(run: Path) -> None:
    """More than a program can call itself, as an archive can hold them."""
    with deep_folder(run):
        assert texts(run) == ["d/d/d/d/d/: is not in the manifest"]


def test_a_folder_that_may_not_be_listed_is_told(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may hold anything."""
    (run / "closed").mkdir()
    iterdir = Path.iterdir

    def allowed(path: Path) -> Iterator[Path]:
        if path.name == "closed":
            raise PermissionError(errno.EACCES, "Permission denied")
        return iterdir(path)

    monkeypatch.setattr(Path, "iterdir", allowed)
    assert texts(run) == ["closed/: cannot be listed: Permission denied"]


@pytest.mark.parametrize("place", [4, 2000, -5, -200])
def test_one_altered_byte_in_a_part(run: Path, place: int) -> None:
    path = run / "samples" / "part-0000.parquet"
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)
    assert any(text.startswith("samples/part-0000.parquet: was changed") for text in texts(run))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_part_cut_short(run: Path, share: float) -> None:
    path = run / "events" / "part-0000.parquet"
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    found = texts(run)
    assert any("events/part-0000.parquet: has" in text for text in found)
    assert any("events/part-0000.parquet: cannot be read" in text for text in found)


def test_a_part_of_another_size_is_not_read_to_hash_it(run: Path) -> None:
    path = run / "samples" / "part-0000.parquet"
    with path.open("r+b") as file:
        file.truncate(4 << 30)  # a sparse file: its hash takes more than 5 s of CPU
    began = time.process_time()
    assert any("was changed: its SHA-256" in text for text in texts(run))
    assert time.process_time() - began < 2


def test_files_missing_added_and_changed(run: Path) -> None:
    (run / "line.toml").write_text("[line]\n")
    (run / "recipes" / "tht.toml").unlink()
    (run / "recipes" / "other.toml").write_text("")
    found = texts(run)
    assert "recipes/tht.toml: is missing" in found
    assert "recipes/other.toml: is not in the manifest" in found
    assert any(text.startswith("line.toml: was changed") for text in found)


def test_a_path_that_leads_out_of_the_folder_is_not_followed(run: Path) -> None:
    manifest = read_manifest(run)
    manifest.files.append(replace(manifest.files[0], path="../../etc/passwd"))
    write_manifest(run, manifest)
    assert "../../etc/passwd: lies outside the run's folder" in texts(run)


def test_a_run_that_is_open(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    write_manifest(folder, Manifest(folder.name))
    assert "not sealed" in texts(folder)[0]


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(RecordError):
        check(tmp_path)


# -- tables rewritten together with the manifest: hashes agree, contents do not --------------------

Change = Callable[[pa.Table], pa.Table]


def rewrite(folder: Path, table: str, change: Change) -> None:
    """Change a table and have the manifest's list of files agree with it."""
    rewritten(folder, table, change)
    manifest = read_manifest(folder)
    manifest.files = list(files_of(folder))
    write_manifest(folder, manifest)


@pytest.mark.parametrize(
    ("table", "change", "said"),
    [
        ("samples", lambda t: t.slice(3), "temperature_c: {'due'"),
        ("samples", lambda t: t.filter(pc.not_equal(t["station"], "ale-1")), "ale-1 port 1"),
        ("samples", lambda t: with_cell(t, 5, "temperature_c", None), "temperature_c"),
        (
            "samples",
            lambda t: with_cell(t, 5, "reasons", "temperature_c=timeout"),
            "a value of temperature_c and a reason",
        ),
        (
            "samples",
            lambda t: with_cell(t, 5, "reasons", "temperature_c=timeout"),
            "quality ok contradicts reasons temperature_c=timeout",
        ),
        (
            "samples",
            lambda t: with_cell(t, 5, "reasons", "colour=red"),
            "colour, which is not a signal",
        ),
        (
            "samples",
            lambda t: with_cell(t, 5, "quality", "timeout"),
            "quality timeout contradicts reasons None",
        ),
        ("samples", lambda t: with_cell(t, 9, "tick", 0), "ticks do not rise"),
        ("samples", lambda t: with_cell(t, 9, "time", 5), "time goes back"),
        ("counters", lambda t: with_cell(t, 0, "value", None), "plugged_h"),
        ("samples", lambda t: t.slice(3), "3 rows missing by seq"),
        (
            "counters",
            lambda t: pa.concat_tables([t.slice(0, 1), t.slice(2)]),
            "counters/: 1 row missing by seq",
        ),
        (
            "settings",
            lambda t: with_cell(t, 1, "seq", 0),
            "settings/: seq does not rise in 1 place",
        ),
        ("settings", lambda t: with_cell(t, 1, "seq", None), "seq does not rise in 1 place"),
        (
            "events",
            lambda t: with_cell(t, 0, "text", "nothing happened"),
            "event 1 does not carry the hash",
        ),
        ("events", lambda t: t.slice(1), "event 1 follows the start; 1 event missing"),
        (
            "events",
            lambda t: pa.concat_tables([t.slice(0, 1), t.slice(2)]),
            "event 2 follows event 0",
        ),
        ("events", lambda t: pa.concat_tables([t, t.slice(0, 1)]), "event 0 stands after event"),
    ],
)
def test_contents_that_do_not_agree(run: Path, table: str, change: Change, said: str) -> None:
    rewrite(run, table, change)
    assert any(said in text for text in texts(run)), texts(run)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("events", "event 2 follows event 0"),
        ("counters", "counters/: 1 row missing by seq"),
    ],
)
def test_a_loss_of_the_last_seconds_explains_no_row_that_is_missing_before(
    run: Path, table: str, said: str
) -> None:
    rewrite(run, table, lambda rows: pa.concat_tables([rows.slice(0, 1), rows.slice(2)]))
    manifest = read_manifest(run)
    told = []
    for seconds in (1.4, None):
        manifest.lost = Lost(seconds, "The recorder ended without closing the record.")
        write_manifest(run, manifest)
        told.append(any(said in text for text in texts(run)))
    assert told == [True, False]


def test_the_due_time_of_a_missed_tick_may_lie_before_a_late_answer(run: Path) -> None:
    def late(samples: pa.Table) -> pa.Table:
        """The answer to a tick comes after the next one was due, which is skipped and has its due
        time.
        """
        mine = pc.and_(
            pc.equal(samples["station"], "dde-1"), pc.equal(samples["port"], 2)
        ).to_pylist()
        rows = [place for place, is_mine in enumerate(mine) if is_mine]
        skipped = samples["time"].to_pylist()[rows[4]]
        samples = with_cell(samples, rows[3], "time", skipped + timedelta(milliseconds=5))
        return with_cell(samples, rows[4], "temperature_c", None)

    rewrite(run, "samples", late)
    assert not any("time goes back" in text for text in texts(run))


def test_a_stepped_clock_explains_a_time_that_goes_back(run: Path) -> None:
    rewrite(run, "samples", lambda t: with_cell(t, 9, "time", 5))
    rewrite(run, "events", lambda t: with_cell(t, 1, "kind", "clock.step"))
    assert not any("time goes back" in text for text in texts(run))


def test_a_ledger_that_was_improved(run: Path) -> None:
    path = run / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["ledger"]["dde-1"]["1"]["temperature_c"]["ok"] += 1
    path.write_text(json.dumps(manifest))
    assert any(
        text.startswith("manifest.json: ledger, dde-1 port 1: temperature_c") for text in texts(run)
    )


def test_a_session_that_counted_otherwise(run: Path) -> None:
    manifest = read_manifest(run)
    manifest.stations[0].due["1"]["temperature_c"] += 1
    write_manifest(run, manifest)
    assert any("121 were due" in text for text in texts(run))


def test_a_list_that_somebody_made_gives_a_hundred_findings_of_a_kind(run: Path) -> None:
    manifest = read_manifest(run)
    gone = [replace(manifest.files[0], path=f"samples/gone-{number:04}") for number in range(3000)]
    write_manifest(run, replace(manifest, files=[*manifest.files, *gone, *gone]))
    (run / "extra").mkdir()
    found = texts(run)
    assert len(found) < 120
    assert found[0] == "samples/gone-0000: is missing"
    # of 6001 of that kind it is not among the first
    assert "manifest.json: files: lists samples/gone-0000 2 times" not in found
    assert "extra/: and 5901 more findings of this kind" in found


def test_a_file_that_is_listed_again_and_again_is_one_finding(run: Path) -> None:
    manifest = read_manifest(run)
    write_manifest(run, replace(manifest, files=[*manifest.files, *[manifest.files[0]] * 5000]))
    assert texts(run) == [f"manifest.json: files: lists {manifest.files[0].path} 5001 times"]
