"""A chained file: whatever is added by two writers, cut off by a crash or changed, what is read are
whole lines in their order, and what is missing or changed is told.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.core import chain as chain_module
from jbclog.core import line_file
from jbclog.core.chain import TAIL, Chain, Content
from jbclog.core.files import Kind
from jbclog.core.json_files import decoder
from jbclog.core.operating_system import read_at


@dataclass(frozen=True, slots=True)
class Note:
    text: str
    seq: int = 0
    prev_sha256: str = ""


read_note = decoder(Note)


@dataclass(frozen=True)
class Append:
    """What one of two writers appends at once; `cut`: a crash keeps so much of it."""

    writer: int
    texts: list[str]
    cut: float | None


TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
CUTS = st.none() | st.floats(0.0, 1.0)
APPENDS = st.builds(Append, st.integers(0, 1), st.lists(TEXTS, min_size=1, max_size=3), CUTS)
HISTORIES = st.lists(APPENDS, min_size=1, max_size=6)


@contextmanager
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def chain_at(path: Path) -> Chain[Note]:
    return Chain(path, Kind.LEDGER, read_note, what="note")


def texts(content: Content[Note]) -> list[str]:
    return [note.text for note in content.entries]


def live(path: Path, history: list[Append]) -> list[str]:
    """Live the history; return the texts that stand in the file as whole lines."""
    writers = (chain_at(path), chain_at(path))
    kept: list[str] = []
    for append in history:
        before = path.stat().st_size if path.exists() else 0
        written = writers[append.writer].append(*map(Note, append.texts))
        assert [note.text for _, note in written] == append.texts
        kept += append.texts
        if append.cut is not None:
            size = path.stat().st_size
            end = before + round(append.cut * (size - before))
            lost = path.read_bytes()[end:]
            os.truncate(path, end)
            # of a line that has lost nothing but its end, nothing is lost
            gone = lost.removesuffix(b"\n").count(b"\n") + (lost != b"" and lost != b"\n")
            kept = kept[: len(kept) - min(gone, len(append.texts))]
    return kept


def is_only_an_end_behind_a_torn_line(path: Path, content: Content[Note]) -> bool:
    """The one state that a crash leaves and that is taken for damage, until the next line."""
    return content.lines[-1][1] is None and path.read_bytes().endswith(b"\n")


@given(HISTORIES)
def test_what_two_writers_and_crashes_leave_is_read_in_order(history: list[Append]) -> None:
    with folder() as home:
        path = home / "chain"
        kept = live(path, history)
        content = chain_at(path).read()
        assert texts(content) == kept
        assert content.damage == [] or is_only_an_end_behind_a_torn_line(path, content)
        assert [note.seq for note in content.entries] == [*range(1, len(kept) + 1)]
        chain_at(path).append(Note("more"))
        content = chain_at(path).read()
        assert (texts(content), content.wrong) == ([*kept, "more"], [])
        assert content.head == content.lines[-1][0]


@given(HISTORIES, st.floats(0.0, 1.0))
def test_a_file_cut_off_anywhere_is_read_to_its_last_whole_line(
    history: list[Append], share: float
) -> None:
    with folder() as home:
        path = home / "chain"
        kept = live(path, history)
        data = path.read_bytes()
        cut = data[: round(share * len(data))]
        content = chain_at(path).content(BytesIO(cut))
        assert texts(content) == kept[: len(content.entries)]
        if not cut.endswith(b"\n"):  # else an earlier crash's line may be the last, and ended
            assert content.damage == []
            assert bool(content.wrong) == bool(cut)


@given(HISTORIES, st.data())
def test_every_changed_byte_is_told_and_costs_its_line(
    history: list[Append], draw: st.DataObject
) -> None:
    with folder() as home:
        path = home / "chain"
        live(path, history)
        chain_at(path).append(Note("last"))
        before = chain_at(path).read()
        whole = texts(before)
        data = bytearray(path.read_bytes())
        place = draw.draw(st.integers(0, len(data) - 1))
        entries = [entry for _, entry in before.lines[data[:place].count(b"\n") :][:2]]
        data[place] ^= 1 << draw.draw(st.integers(0, 7))
        content = chain_at(path).content(BytesIO(data))
        # of lines that crashes cut off one after another, the next one carries the last one's hash
        assert content.wrong or entries == [None, None]
        left = iter(whole)
        assert all(text in left for text in texts(content)), "in order, and none that was not there"
        is_end = path.read_bytes()[place] == ord("\n")
        assert len(content.entries) >= len(whole) - 1 - is_end


@given(HISTORIES, st.data())
def test_a_line_taken_out_or_moved_is_told(history: list[Append], draw: st.DataObject) -> None:
    with folder() as home:
        path = home / "chain"
        live(path, history)
        chain_at(path).append(Note("one"), Note("two"))
        lines = path.read_bytes().splitlines(keepends=True)
        read = [place for place, (_, note) in enumerate(chain_at(path).read().lines) if note]
        place = draw.draw(st.sampled_from(read[:-1]))
        line = lines.pop(place)
        assert chain_at(path).content(lines).wrong
        lines.insert(draw.draw(st.integers(place + 1, len(lines))), line)
        assert chain_at(path).content(lines).wrong


@given(HISTORIES, st.lists(st.floats(0.0, 1.0), max_size=8))
def test_a_follower_sees_each_whole_line_once_and_no_half(
    history: list[Append], looks: list[float]
) -> None:
    with folder() as home:
        path = home / "chain"
        chain = chain_at(path)
        assert chain.lines_since(0) == ([], 0)
        live(path, history)
        data = path.read_bytes()
        seen: list[bytes] = []
        position = 0
        for look in [*sorted(looks), 1.0]:
            end = round(look * len(data))
            path.write_bytes(data[:end])
            lines, position = chain.lines_since(position)
            seen += lines
            assert seen == data[:end].split(b"\n")[:-1]
        longest = max(map(len, data.split(b"\n"))) + 1
        again: list[bytes] = []
        position, last = 0, -1
        while position > last:
            last = position
            lines, position = chain.lines_since(position, longest)
            again += lines
        assert again == seen


@given(st.lists(st.integers(0, 3000) | TEXTS, max_size=12))
def test_reserved_space_takes_the_next_lines_and_is_given_back(
    steps: list[int | str],
) -> None:
    """A number reserves so many bytes, a text is appended."""
    with folder() as home:
        path = home / "chain"
        chain = chain_at(path)
        room, written = 0, list[str]()
        for step in steps:
            size = path.stat().st_size if path.exists() else 0
            if isinstance(step, int):
                chain.reserve(step)
                room = max(room, step)
            else:
                ((_, note),) = chain.append(Note(step))
                written.append(step)
                room -= len(note.text.encode()) * 6 + 300
                assert room < 0 or path.stat().st_size == size
        if path.exists():
            chain.release()
        assert path.exists() == bool(written)
        content = chain.read()
        assert (texts(content), content.wrong) == (written, [])


def test_two_writers_at_once_make_one_chain(tmp_path: Path) -> None:
    path = tmp_path / "chain"
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda number: chain_at(path).append(Note(str(number))), range(100)))
    content = chain_at(path).read()
    assert content.wrong == []
    assert sorted(texts(content), key=int) == [str(number) for number in range(100)]


def test_an_append_to_a_long_file_reads_only_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chain = chain_at(tmp_path / "chain")
    chain.append(*(Note("x" * 1000) for _ in range(5000)))
    sizes: list[int] = []

    def counted(descriptor: int, size: int, start: int) -> bytes:
        sizes.append(size)
        return read_at(descriptor, size, start)

    for module in (chain_module, line_file):
        monkeypatch.setattr(module, "read_at", counted)
    ((_, note),) = chain.append(Note("last"))
    assert (note.seq, chain.read().wrong) == (5001, [])
    assert sum(sizes) < 2 * TAIL
