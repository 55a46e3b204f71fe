"""Frames: what is written is read; damage costs the commits that it lies in, and no others."""

from __future__ import annotations

import errno
import io

from hypothesis import given
from hypothesis import strategies as st

from jbclog.record.frames import (
    Commit,
    Frame,
    FrameKind,
    Gap,
    Mark,
    commit_bytes,
    mark_bytes,
    read_items,
    readable_bytes,
)

FRAMES = st.builds(
    Frame.of,
    st.sampled_from(FrameKind),
    st.binary(max_size=60),
    st.integers(0, 255),
    st.integers(0, 2**64 - 1),
    st.integers(0, 2**32 - 1),
)
COMMITS = st.lists(st.tuples(st.lists(FRAMES, min_size=1, max_size=4), st.booleans()), max_size=6)
"""The frames of each commit, and whether its mark was written."""


def written(commits: list[tuple[list[Frame], bool]]) -> tuple[bytes, list[Commit | Mark]]:
    """The bytes of a segment, and what must be read from it."""
    data, items = b"", list[Commit | Mark]()
    for number, (frames, is_marked) in enumerate(commits):
        start = len(data)
        data += commit_bytes(number, frames)
        items.append(Commit(number, tuple(frames), start, len(data)))
        if is_marked:
            data += mark_bytes(number, 1_000_000 * number)
            items.append(Mark(number, 1_000_000 * number, len(data)))
    return data, items


@given(COMMITS)
def test_what_is_written_is_read_from_every_begin(
    commits: list[tuple[list[Frame], bool]],
) -> None:
    data, items = written(commits)
    assert [*read_items(io.BytesIO(data))] == items
    for place, item in enumerate(items, 1):
        assert [*read_items(io.BytesIO(data), item.end)] == items[place:]


@given(FRAMES)
def test_a_payload_comes_back(frame: Frame) -> None:
    assert len(frame.payload()) == frame.unpacked


@given(COMMITS, st.data())
def test_a_cut_end_costs_only_what_it_cuts(
    commits: list[tuple[list[Frame], bool]], data: st.DataObject
) -> None:
    whole, items = written(commits)
    size = data.draw(st.integers(0, len(whole)))
    left = [item for item in items if item.end <= size]
    found = [*read_items(io.BytesIO(whole[:size]))]
    end = left[-1].end if left else 0
    assert found == left + [Gap(end, size, is_end=True)] * (size > end)


@given(COMMITS.filter(bool), st.data())
def test_a_changed_byte_costs_the_commit_or_mark_that_holds_it(
    commits: list[tuple[list[Frame], bool]], data: st.DataObject
) -> None:
    whole, items = written(commits)
    changed = data.draw(st.integers(0, len(whole) - 1))
    bits = data.draw(st.integers(1, 255))
    damaged = bytearray(whole)
    damaged[changed] ^= bits
    (hit,) = [item for item in items if _start(item) <= changed < item.end]
    found = [*read_items(io.BytesIO(bytes(damaged)))]
    assert [item for item in found if not isinstance(item, Gap)] == [
        item for item in items if item is not hit
    ]
    gaps = [item for item in found if isinstance(item, Gap)]
    assert gaps == [Gap(_start(hit), hit.end, is_end=hit is items[-1])]


class BadBlock(io.BytesIO):
    """A file of which the disk cannot read the second block of 4096 bytes."""

    def read(self, size: int | None = -1, /) -> bytes:
        start = self.tell()
        data = super().read(size)
        if start < 8192 and start + len(data) > 4096:
            raise OSError(errno.EIO, "Input/output error")
        return data


def test_a_block_that_cannot_be_read_costs_the_commits_in_it() -> None:
    frames = [Frame.of(FrameKind.NOTES, bytes([number]) * 200) for number in range(5)]
    whole, items = written([(frames, number % 2 == 0) for number in range(60)])
    left = [item for item in items if item.end <= 4096 or _start(item) >= 8192]
    found = [*read_items(BadBlock(whole))]
    assert [item for item in found if not isinstance(item, Gap)] == left
    (gap,) = [item for item in found if isinstance(item, Gap)]
    assert gap.start <= 4096 < 8192 <= gap.end
    assert gap.is_unreadable
    assert readable_bytes(BadBlock(whole)) == whole[:4096] + bytes(4096) + whole[8192:]
    (end,) = [item for item in read_items(BadBlock(whole[:8000])) if isinstance(item, Gap)]
    assert end.is_end
    assert end.is_unreadable


def _start(item: Commit | Mark) -> int:
    return item.start if isinstance(item, Commit) else item.end - len(mark_bytes(0, 0))


def test_commits_that_lack_a_frame_are_gaps() -> None:
    frames = [Frame.of(FrameKind.NOTES, bytes([number]) * 9) for number in range(3)]
    first, second = commit_bytes(1, frames), commit_bytes(2, frames)
    size = len(first) // 3
    for taken in range(3):  # the first, the middle or the last of three equal frames is not there
        torn = first[: taken * size] + first[(taken + 1) * size :]
        found = [*read_items(io.BytesIO(torn + second))]
        start = len(torn)
        assert found == [
            Gap(0, start, is_end=False),
            Commit(2, tuple(frames), start, start + len(second)),
        ]


class Growing(io.BytesIO):
    """A file to which the rest of a commit is written between two reads."""

    def __init__(self, data: bytes, rest: bytes) -> None:
        super().__init__(data)
        self._rest = rest

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size)
        position = self.tell()
        self.seek(0, io.SEEK_END)
        self.write(self._rest)
        self._rest = b""
        self.seek(position)
        return data


def test_a_commit_that_is_being_written_is_no_damage() -> None:
    frames = [Frame.of(FrameKind.NOTES, b"a note of the run")]
    whole = commit_bytes(1, frames) + mark_bytes(1, 1)
    for written in range(1, len(whole)):
        following = commit_bytes(2, frames) + mark_bytes(2, 2)
        file = Growing(whole[:written], whole[written:] + following)
        assert not [item for item in read_items(file) if isinstance(item, Gap) and not item.is_end]
