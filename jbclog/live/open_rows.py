"""The rows of a run as its followers may see them, table by table: sealed parts first, then what
only the live store has.

Without a lock, like all of `jbclog.live`. A run may be sealed meanwhile; `Sealed` then says that
its rows must be read anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.live.store_follower import StoreFollower
from jbclog.record.parts import groups_of, part_paths, parts_through

AT_ONCE: Final = 64  # batches: a commit of one station has few rows


@dataclass(frozen=True, slots=True)
class OpenRows:
    """The run in `folder` through the batch with the number `through`; None: all of it."""

    folder: Path
    through: int | None

    def groups(self, table: str, columns: list[str]) -> Iterator[pa.Table]:
        """Yield these columns of a table in order, in pieces. Raises Sealed, RecordError."""
        store = StoreFollower(self.folder)
        try:
            # before the parts, so that no row moves between them unseen
            batches = store.refresh(self.through)
            parts = part_paths(self.folder, table)
            sealed = parts_through(parts)
            yield from groups_of(parts, columns)
            live = [number for number, of in batches if of == table and number > sealed]
            for first in range(0, len(live), AT_ONCE):
                read = [store.table(number) for number in live[first : first + AT_ONCE]]
                rows = [one.select(columns) for one in read if one is not None]
                if rows:
                    yield pa.concat_tables(rows).combine_chunks()
        finally:
            store.close()
