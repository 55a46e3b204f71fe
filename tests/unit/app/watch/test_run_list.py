"""The list of runs for the page: who asks without pause makes no work, and no text is long."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from jbclog.app.watch import past_runs, server
from jbclog.app.watch.past_runs import MOST_TEXT, RunList
from jbclog.record.manifest import Manifest, Metadata, write_manifest

RUN = "20261121T013000Z-bench-k7qd"


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The folders that are read from now on."""
    found: list[Path] = []
    whole = past_runs.past_runs
    monkeypatch.setattr(past_runs, "past_runs", lambda path: found.append(path) or whole(path))
    return found


def asked(path: Path, times: int) -> list[str]:
    async def asking() -> list[str]:
        listed = RunList(path)
        together = await asyncio.gather(*(listed.text() for _ in range(times)))
        return [*together, *[await listed.text() for _ in range(times)]]

    return asyncio.run(asking())


def test_it_is_read_once_for_all_who_ask(
    tmp_path: Path, read: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(past_runs, "KEPT_S", 60.0)
    assert asked(tmp_path, 20) == ["[]"] * 40
    assert len(read) == 1
    monkeypatch.setattr(past_runs, "KEPT_S", 0.0)
    assert asked(tmp_path, 2) == ["[]"] * 4
    assert len(read) == 1 + 4


def test_a_folder_that_cannot_be_read_is_tried_again(tmp_path: Path) -> None:
    async def asking() -> str:
        listed = RunList(tmp_path / "runs")
        with pytest.raises(FileNotFoundError):
            await listed.text()
        (tmp_path / "runs").mkdir()
        return await listed.text()

    assert asyncio.run(asking()) == "[]"


def test_a_run_that_may_not_be_entered_hides_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other, exists = RUN.replace("k7qd", "abcd"), Path.exists
    for name in (RUN, other):
        (tmp_path / name).mkdir()
        write_manifest(tmp_path / name, Manifest(name, state="sealed"))

    def refused(path: Path) -> bool:
        if path.parent.name == other:
            raise PermissionError(13, "Permission denied")
        return exists(path)

    monkeypatch.setattr(Path, "exists", refused)
    listed = {one["run"]: one["text"] for one in past_runs.past_runs(tmp_path)}
    assert listed.pop(RUN) != "not readable"
    assert listed == {other: "not readable"}


def test_what_a_manifest_says_is_cut(tmp_path: Path) -> None:
    (tmp_path / RUN).mkdir()
    said = Metadata(order="x" * 1_000_000)
    write_manifest(tmp_path / RUN, Manifest(RUN, state="sealed", metadata=said))
    (one,) = past_runs.past_runs(tmp_path)
    text = str(one["text"])
    assert "order xxx" in text
    assert MOST_TEXT < len(text) < 2 * MOST_TEXT


def test_the_resolver_is_asked_once_whoever_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    times: list[str] = []
    monkeypatch.setattr("socket.getfqdn", lambda: times.append("") or "line-pc.plant")
    server.own_names.cache_clear()
    try:
        access = server.Access("0.0.0.0", "a-token-of-24-characters")
        known = [access.knows_host(name) for name in ("evil.example", "line-pc.plant:80", "x")]
        assert known == [False, True, False]
        assert len(times) == 1
    finally:
        server.own_names.cache_clear()
