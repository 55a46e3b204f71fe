"""Each run carries the head of the one before it on its line, so that neither can be written anew
unseen.
"""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.record.chains import HEAD, is_head, previous_run, short_head
from jbclog.record.check import check
from jbclog.record.manifest import (
    LineFile,
    Manifest,
    Previous,
    manifest_sha256,
    read_manifest,
    write_manifest,
)
from support.records.small_run import make_run

NAMES = (
    "20260921T141318Z-bench-aaaa",
    "20260921T141319Z-bench-aaab",
    "20260921T141320Z-bench-aaac",
)


def sealed(
    out: Path, name: str, line: str = "bench", state: str = "sealed", **more: object
) -> Path:
    """A run that is only a manifest."""
    folder = out / name
    folder.mkdir(parents=True)
    write_manifest(
        folder, replace(Manifest(name, state=state, line=LineFile(line, "line.toml", "00")), **more)
    )  # type: ignore[arg-type]
    return folder


def findings(folder: Path, head: str | None = None) -> list[str]:
    """Without what is said of a run that has no files."""
    return [str(one) for one in check(folder, head) if one.file == "manifest.json"]


def test_the_first_run_says_that_there_is_none(tmp_path: Path) -> None:
    told = Previous(None, None, "The first run of line bench in this folder.")
    assert previous_run(tmp_path / "not-there", "bench") == told
    sealed(tmp_path, "20260921T141318Z-bench-2-aaaa", "bench-2")
    (tmp_path / "notes.txt").write_text("no run")
    assert previous_run(tmp_path, "bench") == told


def test_it_is_the_newest_that_is_sealed(tmp_path: Path) -> None:
    for name in NAMES[:2]:
        sealed(tmp_path, name)
    sealed(tmp_path, NAMES[2], state="open")
    found = previous_run(tmp_path, "bench")
    assert (found.run, found.sha256) == (NAMES[1], manifest_sha256(tmp_path / NAMES[1]))


def test_of_thousands_only_the_newest_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A start waits for this: it lists the folder once, and looks at no other run."""
    for name in NAMES:
        sealed(tmp_path, name)
    looked, real = list[Path](), Path.stat

    def stat(path: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        looked.append(path)
        return real(path, follow_symlinks=follow_symlinks)

    monkeypatch.setattr(Path, "stat", stat)
    assert previous_run(tmp_path, "bench").run == NAMES[-1]
    older = {tmp_path / name for name in NAMES[:-1]}
    assert not [path for path in looked if older & {path, *path.parents}]


def test_where_none_is_sealed_it_says_so(tmp_path: Path) -> None:
    sealed(tmp_path, NAMES[0], state="open")
    (tmp_path / NAMES[1]).mkdir()
    (tmp_path / NAMES[2]).symlink_to(tmp_path / NAMES[0])
    assert previous_run(tmp_path, "bench") == Previous(
        None, None, "No run of line bench in this folder was sealed when this one began."
    )


@pytest.fixture
def three(tmp_path: Path) -> list[Path]:
    return [sealed(tmp_path, name, previous=previous_run(tmp_path, "bench")) for name in NAMES]


def test_a_chain_as_it_was_made(three: list[Path]) -> None:
    assert [findings(folder) for folder in three] == [[], [], []]


def test_a_run_that_was_written_anew_is_found_from_both_sides(three: list[Path]) -> None:
    """Consistent in itself, its digest too: only its neighbours know."""
    before = short_head(manifest_sha256(three[1]))
    write_manifest(three[1], replace(read_manifest(three[1]), verdict="ACCEPT"))
    after = short_head(manifest_sha256(three[1]))
    carried = f"its head is {after}, carried is {before}"
    assert findings(three[0]) == []
    assert findings(three[1]) == [f"manifest.json: was changed after {NAMES[2]} began: {carried}"]
    assert findings(three[2]) == [
        f"manifest.json: previous: {NAMES[1]} is not what it was when this run began: {carried}"
    ]


def test_a_neighbour_that_is_not_there_cannot_be_asked(three: list[Path]) -> None:
    (three[1] / "manifest.json").unlink()
    three[1].rmdir()
    assert [findings(folder) for folder in (three[0], three[2])] == [[], []]


@pytest.mark.parametrize("name", ["../../etc", "/etc", "..", "", "a\0b", "\x1b[2J", "x" * 5000])
def test_a_name_that_leads_elsewhere_is_not_followed(tmp_path: Path, name: str) -> None:
    (text,) = findings(sealed(tmp_path, NAMES[0], previous=Previous(name, "0" * 64, "")))
    assert text.startswith("manifest.json: previous: ")
    assert text.endswith("is no run's name")
    assert text.isprintable()


def test_the_head_on_paper_finds_a_run_without_neighbours(tmp_path: Path) -> None:
    run = make_run(tmp_path, seconds=2.0)
    printed = short_head(manifest_sha256(run))
    assert check(run, printed) == check(run, manifest_sha256(run).upper()) == []
    write_manifest(run, replace(read_manifest(run), verdict="ACCEPT"))
    assert check(run) == []
    (finding,) = check(run, printed)
    assert str(finding).startswith("manifest.json: its head is ")


def test_heads_as_people_type_them() -> None:
    sha256 = "3f2a91bc77de0a12" + "0" * 48
    for typed in ("3f2a-91bc-77de-0a12", "3F2A 91BC 77DE 0A12", "3f2a91bc77de0a12", sha256):
        assert HEAD.fullmatch(typed)
        assert is_head(typed, sha256)
    for typed in ("3f2a-91bc", "", "3f2a-91bc-77de-0a1", "3f2a-91bc-77de-0a13", sha256[:-1] + "1"):
        assert not is_head(typed, sha256)
    for typed in ("3f2a-91bc", "xyz", "", sha256 + "0000"):
        assert not HEAD.fullmatch(typed)
    assert short_head(sha256).replace("-", "") == sha256[:24]  # 96 bits
    assert is_head(short_head(sha256), sha256)
    assert not is_head(short_head(sha256)[:-1] + "1", sha256)


def test_a_report_of_another_record_is_found(tmp_path: Path) -> None:
    run = make_run(tmp_path, seconds=2.0)
    (run / "report.json").write_text(json.dumps({"manifest_sha256": "ab" * 32}))
    (finding,) = check(run)
    assert str(finding).startswith(
        "report.json: was made from manifest abab-abab-abab-abab-abab-abab, not from this one, "
    )
    for text in ("", "[]", "1", "{}", "[" * 9000):
        (run / "report.json").write_text(text)
        assert [str(one) for one in check(run)] == ["report.json: is not a run's report"]


def test_the_folder_of_the_run_itself_is_none_before_it(tmp_path: Path) -> None:
    own = tmp_path / "20261125T120000Z-bench-k7qd"
    own.mkdir()
    assert "was sealed" in previous_run(tmp_path, "bench").text
    assert previous_run(tmp_path, "bench", own) == previous_run(tmp_path / "not-there", "bench")
