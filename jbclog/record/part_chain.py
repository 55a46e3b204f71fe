"""The parts that an open run has: the hash chain `parts.jsonl`. A part counts when it is in there.

It is removed with the journal when the run is sealed, because the manifest lists the parts then.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jbclog.core.chain import Chain
from jbclog.core.files import Kind
from jbclog.core.json_files import builder, json_of
from jbclog.record.manifest import SealedFile

if TYPE_CHECKING:
    from jbclog.record.part_writer import WrittenPart

NAME: Final = "parts.jsonl"


@dataclass(frozen=True, slots=True)
class ChainedPart:
    """A part of the rows of a segment: its least and greatest `seq`, None without rows."""

    seq: int
    prev_sha256: str
    segment: int
    first_seq: int | None
    last_seq: int | None
    file: SealedFile

    @property
    def table(self) -> str:
        return self.file.path.partition("/")[0]


_build_part: Final = builder(ChainedPart)


class PartChain:
    """The chain of the run in `folder` as it is now, and what this object adds. `damage` lists
    lines that cannot be read. Raises OSError.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._chain = Chain(folder / NAME, Kind.LEDGER, _read_part, what="part")
        content = self._chain.read()
        self.damage = content.damage
        self._by_path = {part.file.path: part for part in content.entries}  # the last one counts

    @property
    def parts(self) -> list[ChainedPart]:
        return list(self._by_path.values())

    def of(self, table: str) -> list[ChainedPart]:
        """Return the parts of a table, oldest first."""
        return [part for part in self._by_path.values() if part.table == table]

    def has(self, table: str, segment: int) -> bool:
        """Return True if the rows of a segment are in a part that is there."""
        return any(
            part.segment == segment and (self.folder / part.file.path).exists()
            for part in self.of(table)
        )

    def last_seq(self, table: str, before: int | None = None) -> int:
        """Return the greatest `seq` in the parts of a table, of segments `before` one; -1 if there
        is none.
        """
        numbers = [
            part.last_seq
            for part in self.of(table)
            if part.last_seq is not None and (before is None or part.segment < before)
        ]
        return max(numbers, default=-1)

    def add(self, segment: int, written: WrittenPart) -> None:
        """Append a part, synced."""
        file = SealedFile(
            written.path.relative_to(self.folder).as_posix(),
            written.rows,
            written.bytes,
            written.sha256,
            written.footer_bytes,
            written.footer_sha256,
        )
        part = ChainedPart(0, "", segment, written.first_seq, written.last_seq, file)
        ((_, kept),) = self._chain.append(part)
        self._by_path[file.path] = kept


def _read_part(line: bytes) -> ChainedPart:
    return _build_part(json_of(line))
