"""A run's folder is new, named as docs/reference/run-folder.md says, and known to take writes."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from jbclog.core import durable_files
from jbclog.core.errors import RecordError
from jbclog.record.folder import RUN_NAME, create_run, expect_no_links, keep_text
from support.faults.deep_folder import deep_folder

NOBODY = 65534
START = 1_795_224_600.25  # 2026-11-21T01:30:00.25Z


def test_the_name_says_when_and_where(tmp_path: Path) -> None:
    folder = create_run(tmp_path / "runs" / "deep", "bench-3", START)
    assert re.fullmatch(r"20261121T013000Z-bench-3-[a-z2-9]{4}", folder.name)
    assert RUN_NAME.fullmatch(folder.name)
    assert list(folder.iterdir()) == []


def test_no_two_runs_share_a_folder(tmp_path: Path) -> None:
    with ThreadPoolExecutor(16) as pool:
        folders = list(pool.map(lambda _: create_run(tmp_path, "bench", START), range(100)))
    assert len(set(folders)) == 100


@pytest.mark.parametrize(
    "name", ["", ".", "..", "a/b", "../a", "a\n", "-a b", ".hidden", "a" * 65, "a\x1b[31m", "ä"]
)
def test_a_hostile_line_name_makes_no_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(RecordError):
        create_run(tmp_path, name, START)
    assert list(tmp_path.iterdir()) == []


def test_a_link_is_found_wherever_it_is(tmp_path: Path) -> None:
    run = tmp_path / "run"
    (run / "samples" / "more").mkdir(parents=True)
    (run / "samples" / "part").write_text("")
    expect_no_links(run)
    expect_no_links(tmp_path / "not there")
    for place in ("samples/more/link", "samples/another", "a link"):
        (run / place).symlink_to(tmp_path)
        with pytest.raises(RecordError) as refused:
            expect_no_links(run)
        assert str(refused.value) == (
            f"{run / place} is a link; a run's folder holds none. Nothing was changed"
        )
        (run / place).unlink()


def test_folders_in_one_another_are_no_run(tmp_path: Path) -> None:
    with deep_folder(tmp_path), pytest.raises(RecordError, match="more folders in one another"):
        expect_no_links(tmp_path)


def test_a_file_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("")
    with pytest.raises(RecordError, match="No station was touched"):
        create_run(tmp_path / "runs", "bench", START)


@contextlib.contextmanager
def without_the_rights_of_root() -> Iterator[None]:
    """Root may write everywhere; nobody may not."""
    own = os.geteuid()
    if own == 0:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(own)


def test_a_folder_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with without_the_rights_of_root(), pytest.raises(RecordError, match="cannot hold a record"):
        create_run(tmp_path, "bench", START)


def test_a_disk_that_does_not_sync_is_found_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(path: Path) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(durable_files, "sync_file", broken)
    with pytest.raises(RecordError, match="Input/output error") as raised:
        create_run(tmp_path, "bench", START)
    assert raised.value.exit_code == 4
    assert list(tmp_path.iterdir()) == []


def test_texts_are_kept_to_the_byte(tmp_path: Path) -> None:
    text = '[recipe]\r\nname = "ä"\n\n'
    keep_text(tmp_path, "recipes/tht.toml", text)
    assert (tmp_path / "recipes/tht.toml").read_bytes() == text.encode()
    assert [path.name for path in tmp_path.rglob("*")] == ["recipes", "tht.toml"]
