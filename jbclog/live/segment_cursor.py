"""Reads the marked commits of a segment of the journal, each once, while it is written.

The cursor stands at the last mark. What is behind it may still change: a commit whose write failed
is cut off and written again. So nothing behind the mark is kept, and each look reads it anew.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from jbclog.core.files import Kind, open_regular
from jbclog.record.frames import MARK_HEAD, Commit, Gap, Mark, mark_bytes, read_items


class SegmentCursor:
    """A place in the segment at `path`. The file is open only during a look: one that is removed
    needs no space on the disk then, and network file systems show new bytes after opening.

    `mark` is the last mark. `damage` has the gaps between commits.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.mark: Mark | None = None
        self.damage: list[Gap] = []
        self.is_doubtful = False  # gaps were seen for the first time; the next look decides
        self._gaps: set[Gap] = set()

    def read(self, through: int = 0) -> list[Commit]:
        """Return the commits that were marked since the last look. `through`: the number of the
        last commit that is on the disk as the next segment says. Raises OSError.
        """
        with open_regular(self.path, Kind.STORE) as file:
            return self._read(file, through)

    def _read(self, file: BinaryIO, through: int) -> list[Commit]:
        mark = self.mark
        marked: list[Commit] = []
        unmarked: list[Commit] = []
        damage: list[Gap] = []
        new_gaps: set[Gap] = set()
        for item in read_items(file, self._start(file)):
            if isinstance(item, Gap):
                if item.is_end:
                    break
                if item in self._gaps:
                    damage.append(item)
                else:  # or only half of it was written when it was read
                    new_gaps.add(item)
            elif new_gaps:
                continue
            elif isinstance(item, Commit):
                unmarked.append(item)
            else:
                mark = item
                marked += [commit for commit in unmarked if commit.number <= item.number]
                unmarked = [commit for commit in unmarked if commit.number > item.number]
        self.mark = mark
        self.damage = [*self.damage, *(gap for gap in damage if gap not in self.damage)]
        self.is_doubtful = bool(new_gaps)
        self._gaps |= new_gaps
        if not new_gaps:
            marked += [commit for commit in unmarked if commit.number <= through]
        return marked

    def _start(self, file: BinaryIO) -> int:
        """Return where to read from: the last mark, or the begin if that is not there any more."""
        if self.mark is None:
            return 0
        start = self.mark.end - MARK_HEAD.size
        file.seek(start)
        is_there = file.read(MARK_HEAD.size) == mark_bytes(self.mark.number, self.mark.utc_us)
        return start if is_there else 0


def first_mark(path: Path) -> Mark | None:
    """Return the first mark of a segment, None if it has none yet. Raises OSError."""
    with open_regular(path, Kind.STORE) as file:
        for item in read_items(file):
            if isinstance(item, Mark):
                return item
    return None
