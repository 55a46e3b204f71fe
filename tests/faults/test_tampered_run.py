"""A sealed run that is damaged or changed: `check` finds it and names the file. A run whose hashes
were all computed again shows only from outside.

Each change is made to a whole run with annotations, then undone. The campaign flips every byte of
every file and takes some minutes; the default run flips a few bytes of each file.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pytest

from jbclog.core.errors import RecordError
from jbclog.record.annotations import append
from jbclog.record.annotations import read as read_annotations
from jbclog.record.chains import breaks, digest, first_link, previous_run, short_head
from jbclog.record.check import check
from jbclog.record.cross_check import uncovered
from jbclog.record.guard_actions import plain_events
from jbclog.record.ledger import ledger_of
from jbclog.record.manifest import (
    DIGEST,
    END,
    SINCE_DIGEST,
    manifest_sha256,
    read_manifest,
    write_manifest,
)
from jbclog.report.write import write_report
from support.invoked import invoked
from support.readers.run_files import differing_files
from support.records.few_rows import rewritten
from support.records.listed_files import files_of
from support.records.small_run import make_run

STRIDE = 2999


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two seconds with two annotations."""
    run = make_run(tmp_path_factory.mktemp("runs"), seconds=2.0)
    for text in ("SN-0012 was scrapped", "SN-0013 too"):
        append(run, who="A. Rossi", what=text, why="cracked joint", utc_s=1_790_000_100.0)
    assert check(run) == []
    return run


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    """A separate copy of it."""
    return Path(shutil.copytree(whole, tmp_path / whole.name))


@pytest.fixture(scope="module")
def whole_with_report(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with a report, and with annotations made after that."""
    run = Path(shutil.copytree(whole, tmp_path_factory.mktemp("reported") / whole.name))
    write_report(run)
    append(run, who="A. Rossi", what="SN-0014 too", why="cracked joint", utc_s=1_790_000_200.0)
    assert check(run) == []
    return run


@pytest.fixture
def reported(whole_with_report: Path, tmp_path: Path) -> Path:
    """A separate copy of the one with a report."""
    return Path(shutil.copytree(whole_with_report, tmp_path / "reported" / whole_with_report.name))


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def named(folder: Path) -> set[str]:
    """Return the files that `check` names; for an unreadable manifest, the manifest."""
    try:
        return {finding.file for finding in check(folder)}
    except RecordError as error:
        return {"manifest.json"} if "manifest" in str(error) else set()


def name_of(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix()


# -- bytes -----------------------------------------------------------------------------------------


def turned_over(
    folder: Path, places: Callable[[int], Iterator[int]], those: list[Path] | None = None
) -> Iterator[str]:
    """Yield each byte whose change was not found: file and place, of all files or `those`."""
    for path in files(folder) if those is None else those:
        data = path.read_bytes()
        for place in places(len(data)):
            path.write_bytes(
                data[:place] + bytes([data[place] ^ (1 << place % 8)]) + data[place + 1 :]
            )
            if name_of(path, folder) not in named(folder):
                yield f"{name_of(path, folder)}, byte {place}"
        path.write_bytes(data)


def test_bytes_that_are_turned_over_are_found_and_their_file_is_named(run: Path) -> None:
    def some(size: int) -> Iterator[int]:
        return iter(sorted({*range(7, size, STRIDE), 0, size - 1, size - 2}))

    assert list(turned_over(run, some)) == []
    assert check(run) == []


def test_bytes_of_a_report_that_are_turned_over_are_found_and_their_file_is_named(
    whole: Path, reported: Path
) -> None:
    of_report = [path for path in files(reported) if not (whole / name_of(path, reported)).exists()]
    assert len(of_report) > 10
    assert list(turned_over(reported, lambda size: iter((size // 2,)), of_report)) == []
    lines = [reported / "report.json", reported / "annotations.jsonl"]
    assert list(turned_over(reported, lambda size: iter((size // 2, size - 1)), lines)) == []
    assert check(reported) == []
    assert list(uncovered(reported, None)) == []


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_every_97th_byte_of_a_report_and_of_every_file_beside_it(
    reported: Path, counted: Callable[..., None]
) -> None:
    count = sum(len(range(0, path.stat().st_size, 97)) for path in files(reported))
    assert list(turned_over(reported, lambda size: iter(range(0, size, 97)))) == []
    counted(bytes_turned_over=count, unnoticed=0)


@pytest.mark.campaign
@pytest.mark.timeout(3 * 3600)
def test_every_byte_of_every_file(run: Path, counted: Callable[..., None]) -> None:
    count = sum(path.stat().st_size for path in files(run))
    print(f"{count} bytes in {len(files(run))} files")
    assert list(turned_over(run, lambda size: iter(range(size)))) == []
    counted(bytes_turned_over=count, unnoticed=0)


def test_each_file_cut_short_emptied_and_lengthened(run: Path) -> None:
    for path in files(run):
        data = path.read_bytes()
        for changed in (b"", data[:-1], data[: len(data) // 2], data + b"\n", data + data[-64:]):
            path.write_bytes(changed)
            if path.name == "annotations.jsonl" and changed == b"":
                continue  # nothing inside shows this: see the last tests
            assert name_of(path, run) in named(run), f"{name_of(path, run)} of {len(changed)} bytes"
        path.write_bytes(data)


def test_each_file_taken_away(run: Path) -> None:
    for path in files(run):
        if path.name == "annotations.jsonl":
            continue
        data = path.read_bytes()
        path.unlink()
        assert name_of(path, run) in named(run)
        path.write_bytes(data)


def test_each_file_replaced_by_a_link_to_a_copy_of_it(run: Path, tmp_path: Path) -> None:
    for path in files(run):
        if path.name == "manifest.json":
            continue
        copy = shutil.copy(path, tmp_path / path.name)
        data = path.read_bytes()
        path.unlink()
        path.symlink_to(copy)
        assert name_of(path, run) in named(run)
        path.unlink()
        path.write_bytes(data)


@pytest.mark.parametrize(
    "name",
    [
        *(
            "samples/part-0001.parquet",
            "samples/.hidden",
            "samples/more/part-0000.parquet",
            "recipes/other.toml",
            "note.txt",
        ),
        *(
            "damaged/x",
            "guard.jsonl",
            "events.csv",
            "wire/dde-1.tsv",
            "figures/x/y.svg",
            "figures/run.exe",
            "lease.json.tmp",
        ),
    ],
)
def test_a_file_that_was_added(run: Path, name: str) -> None:
    (run / name).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(run / "samples" / "part-0000.parquet", run / name)
    assert name in named(run)


def test_two_files_that_changed_places(run: Path) -> None:
    one, two = run / "counters" / "part-0000.parquet", run / "settings" / "part-0000.parquet"
    one.rename(run / "aside")
    two.rename(one)
    (run / "aside").rename(two)
    assert {name_of(one, run), name_of(two, run)} <= named(run)


# -- rows, in files whose hashes the manifest no longer has ----------------------------------------


def taken(*rows: int) -> Callable[[pa.Table], pa.Table]:
    """Return only these rows, in this order, and all that follow the last."""
    return lambda table: pa.concat_tables([table.take(list(rows)), table.slice(max(rows) + 1)])


ROWS = {
    "two rows changed places": taken(1, 0),
    "a row is gone": taken(1),
    "a row is there twice": taken(0, 0),
}


@pytest.mark.parametrize("table", ["samples", "events", "settings", "counters"])
@pytest.mark.parametrize("change", ROWS)
def test_rows(run: Path, table: str, change: str) -> None:
    rewritten(run, table, ROWS[change])
    assert f"{table}/part-0000.parquet" in named(run)


@pytest.mark.parametrize("change", ROWS)
def test_events_whose_file_the_manifest_was_made_to_agree_with(run: Path, change: str) -> None:
    rewritten(run, "events", ROWS[change])
    write_manifest(run, replace(read_manifest(run), files=list(files_of(run))))
    assert "events/" in named(run)


# -- rewritten completely, with hashes and digest: nothing inside can show it ----------------------


def rewritten_whole(folder: Path) -> None:
    """Hotter tips, no alarm, a new chain of events; ledger, hashes, digest and verdict recomputed
    to agree.
    """

    def cooler(rows: pa.Table) -> pa.Table:
        place = rows.schema.get_field_index("temperature_c")
        return rows.set_column(
            place, rows.schema.field(place), pc.min_element_wise(rows["temperature_c"], 350)
        )

    def without_errors(rows: pa.Table) -> pa.Table:
        kept = plain_events(rows.filter(pc.not_equal(rows["severity"], "critical"))).to_pylist()
        previous = first_link(folder.name)
        for seq, row in enumerate(kept):
            row["seq"], row["prev_sha256"] = seq, previous
            previous = digest(row)
        assert list(breaks(folder.name, kept)) == []
        times = ("time", "earliest")
        return pa.Table.from_pylist(
            [
                {name: _stamp(value) if name in times else value for name, value in row.items()}
                for row in kept
            ],
            rows.schema,
        )

    rewritten(folder, "samples", cooler)
    rewritten(folder, "events", without_errors)
    manifest = read_manifest(folder)
    write_manifest(
        folder,
        replace(
            manifest,
            verdict="ACCEPT",
            ledger=ledger_of(folder, manifest.stations),
            files=list(files_of(folder)),
        ),
    )


def _stamp(micros: object) -> object:
    return (
        None
        if micros is None
        else pa.scalar(micros, pa.int64()).cast(pa.timestamp("us", tz="UTC")).as_py()
    )


@pytest.fixture
def bare(run: Path) -> Path:
    """The run without its annotations."""
    (run / "annotations.jsonl").unlink()
    return run


def test_a_run_rewritten_whole_agrees_with_itself(bare: Path) -> None:
    """The README says that only something outside the folder reveals it."""
    rewritten_whole(bare)
    assert check(bare) == []


def test_the_head_on_paper_finds_it(bare: Path) -> None:
    printed = short_head(manifest_sha256(bare))
    rewritten_whole(bare)
    (finding,) = check(bare, printed)
    assert "not the given one" in str(finding)


def test_the_report_beside_it_finds_it(bare: Path) -> None:
    write_report(bare)
    assert check(bare) == []
    rewritten_whole(bare)
    one, two = map(str, check(bare))
    assert one.startswith("annotations.jsonl: line 1 does not carry the hash of the manifest")
    assert two.startswith("report.json: was made from manifest")


def test_an_annotation_finds_it(run: Path) -> None:
    rewritten_whole(run)
    (finding,) = check(run)
    assert str(finding).startswith(
        "annotations.jsonl: line 1 does not carry the hash of the manifest"
    )


def test_the_next_run_finds_it_and_is_found_itself(bare: Path) -> None:
    behind = bare.parent / bare.name.replace(bare.name[:8], "20991231")
    shutil.copytree(bare, behind)
    manifest = replace(
        read_manifest(behind), run=behind.name, previous=previous_run(bare.parent, "bench")
    )
    assert manifest.previous is not None
    manifest.previous = replace(manifest.previous, run=bare.name, sha256=manifest_sha256(bare))
    write_manifest(behind, manifest)
    rewritten_whole(bare)
    assert any(f"was changed after {behind.name} began" in str(finding) for finding in check(bare))
    assert any(
        f"previous: {bare.name} is not what it was" in str(finding) for finding in check(behind)
    )


def test_what_was_said_last_can_be_taken_away_unless_its_head_was_noted(run: Path) -> None:
    """The README says so, too: `annotate` prints the head."""
    path = run / "annotations.jsonl"
    path.write_bytes(path.read_bytes().splitlines(keepends=True)[0])
    assert check(run) == []


# -- files of a report -----------------------------------------------------------------------------

OF_REPORT = ("report.html", "report.pdf", "derived/joints.parquet", "tables/rules.csv")


def test_a_report_s_files_are_vouched_for_by_its_json(run: Path) -> None:
    write_report(run)
    assert check(run) == []
    for name in OF_REPORT:
        whole = (run / name).read_bytes()
        (run / name).write_bytes(whole.replace(b"e", b"a", 1))
        assert named(run) == {name}
        (run / name).unlink()
        assert named(run) == {name}
        (run / name).write_bytes(whole)
    assert check(run) == []


def test_a_foreign_page_in_a_run_without_a_report(bare: Path) -> None:
    (bare / "report.html").write_text("ACCEPT")
    assert named(bare) == {"report.html"}
    write_report(bare)
    assert named(bare) == set()
    (bare / "figures" / "more.svg").write_text("<svg/>")
    assert named(bare) == {"figures/more.svg"}


def altered(folder: Path, change: Callable[[dict[str, object]], object]) -> None:
    """Return the report's facts with a change."""
    facts = json.loads((folder / "report.json").read_bytes())
    change(facts)
    (folder / "report.json").write_text(json.dumps(facts))


def accepted(facts: dict[str, object]) -> None:
    facts["verdict"] = {**facts["verdict"], "word": "ACCEPT"}  # type: ignore[dict-item]


def without_its_line(folder: Path) -> None:
    """Return the annotations up to the line with the report's hash."""
    path = folder / "annotations.jsonl"
    path.write_bytes(b"".join(line for line in path.read_bytes().splitlines(keepends=True)[:2]))


def test_a_report_made_twice_is_vouched_for_once_and_names_what_was_said_before(bare: Path) -> None:
    append(bare, who="A. Rossi", what="SN-0012 was scrapped", why="cracked joint")
    head = read_annotations(bare).head
    write_report(bare)
    made = {path: path.read_bytes() for path in files(bare)}
    write_report(bare)
    assert {path: path.read_bytes() for path in files(bare)} == made
    assert (
        read_annotations(bare).head
        == head
        == json.loads((bare / "report.json").read_bytes())["annotations_head"]
    )
    assert len(read_annotations(bare).said) == 1
    assert differing_files(bare) == []


def test_a_report_behind_a_line_that_was_cut_off_is_what_it_is_when_made_again(run: Path) -> None:
    with (run / "annotations.jsonl").open("ab") as file:
        file.write(b'{"seq": 3, "ti')
    write_report(run)
    assert check(run) == []
    assert differing_files(run) == []


def test_a_report_that_was_changed(reported: Path) -> None:
    altered(reported, accepted)
    assert named(reported) == {"report.json"}
    assert invoked("check", reported).exit_code == 1


def test_a_report_that_was_changed_whose_line_was_taken_away(reported: Path) -> None:
    without_its_line(reported)
    assert [str(one) for one in check(reported)] == [
        "report.json: cites a line of annotations.jsonl that is gone; make the report again"
    ]
    altered(reported, lambda facts: facts.pop("vouched_in"))
    assert named(reported) == set()
    assert [file for file, _ in uncovered(reported, None)] == ["report.json"]
    said = invoked("check", reported)
    assert said.exit_code == 0
    assert "not covered: report.json: not vouched for" in said.output


def test_a_page_that_was_changed_after_the_list_of_written_files_was_removed(
    reported: Path,
) -> None:
    altered(reported, lambda facts: facts.pop("written"))
    (reported / "report.html").write_text("ACCEPT")
    assert named(reported) == {"report.json"}
    without_its_line(reported)
    altered(reported, lambda facts: facts.pop("vouched_in"))
    assert named(reported) == set()
    on_list = {file for file, _ in uncovered(reported, None)}
    assert {
        "report.json",
        "report.html",
        "report.pdf",
        "derived/joints.parquet",
        "tables/rules.csv",
    } <= on_list


def test_what_was_said_before_the_report_is_taken_away_with_its_line(reported: Path) -> None:
    (reported / "annotations.jsonl").unlink()
    altered(reported, lambda facts: facts.pop("vouched_in"))
    (finding,) = check(reported)
    assert str(finding).startswith(
        "annotations.jsonl: lacks the line that was last when report.json was made"
    )


def test_a_report_that_was_taken_away(reported: Path) -> None:
    (reported / "report.json").unlink()
    assert "report.json" in named(reported)


@pytest.mark.parametrize(
    "name", ["report.pdf", "annotations.jsonl", "guard.lock", "lease.json", "figures/x.svg"]
)
def test_a_folder_under_the_name_of_a_file(bare: Path, name: str) -> None:
    (bare / name).mkdir(parents=True)
    (bare / name / "x").write_text("x")
    assert any(file.startswith(name) for file in named(bare))


def test_a_pipe_under_the_name_of_a_page(bare: Path) -> None:
    os.mkfifo(bare / "report.pdf")
    assert named(bare) == {"report.pdf"}


def test_a_guard_s_lock_is_an_empty_file_or_not_there(run: Path, tmp_path: Path) -> None:
    lock = run / "guard.lock"
    lock.touch()
    assert check(run) == []
    assert [file for file, _ in uncovered(run, None)] == ["guard.lock"]
    lock.write_bytes(bytes(1 << 20))
    assert named(run) == {"guard.lock"}
    lock.unlink()
    (tmp_path / "elsewhere").touch()
    lock.symlink_to(tmp_path / "elsewhere")
    assert named(run) == {"guard.lock"}


# -- downgraded to an older record -----------------------------------------------------------------


def downgrades(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the manifest without each of its keys, with a matching digest, and as one of
    0.1.0.
    """
    facts = json.loads((folder / "manifest.json").read_bytes())
    del facts["digest"]
    for key in facts:
        yield (
            f"without {key}",
            with_digest({name: value for name, value in facts.items() if name != key}),
        )
    yield "of rules 1", with_digest({**facts, "rules": 1})
    yield (
        "of 0.1.0",
        plain({name: value for name, value in facts.items() if name != SINCE_DIGEST}),
    )
    yield "without a digest", plain(facts)


def plain(facts: dict[str, object]) -> bytes:
    return (json.dumps(facts, indent=1, ensure_ascii=False) + "\n").encode()


def with_digest(facts: dict[str, object]) -> bytes:
    text = plain(facts)
    return text.removesuffix(END) + (DIGEST % hashlib.sha256(text).hexdigest()).encode()


def test_each_downgrade_of_the_manifest_is_found_where_the_head_is_known(
    bare: Path, counted: Callable[..., None]
) -> None:
    printed, data = short_head(manifest_sha256(bare)), (bare / "manifest.json").read_bytes()
    assert len(printed.replace("-", "")) == 24
    count = 0
    for name, changed in downgrades(bare):
        (bare / "manifest.json").write_bytes(changed)
        try:
            found = [str(finding) for finding in check(bare, printed)]
        except RecordError as error:
            found = [str(error)]
        assert any("manifest" in text for text in found), name
        count += 1
    assert count > 20
    (bare / "manifest.json").write_bytes(data)
    assert check(bare, printed) == []
    counted(downgrades=count, unnoticed=0)


def test_a_manifest_of_0_1_0_is_on_the_list_of_what_is_not_covered(bare: Path) -> None:
    (bare / "manifest.json").write_bytes(dict(downgrades(bare))["of 0.1.0"])
    assert [file for file, _ in uncovered(bare, None)] == ["manifest.json"]
    assert list(uncovered(bare, manifest_sha256(bare))) == []


def test_a_manifest_behind_a_link(bare: Path, tmp_path: Path) -> None:
    (bare / "manifest.json").rename(tmp_path / "elsewhere.json")
    (bare / "manifest.json").symlink_to(tmp_path / "elsewhere.json")
    assert "manifest.json" in named(bare)
