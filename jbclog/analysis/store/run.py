"""A run in a store as `Run`: code that reads the folder of a run also reads this one.

Its small files (manifest, annotations, line, recipes) are written to a temporary folder, which is
removed with the object. Rows come from the store, only the requested columns.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.run import Run
from jbclog.analysis.run_tables import Selection, arrow_time
from jbclog.analysis.store.plain_files import is_name
from jbclog.analysis.store.reader import Published, Store
from jbclog.analysis.store.schema import OWN
from jbclog.analysis.verdict import RULES
from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError
from jbclog.record.manifest import NAME as MANIFEST


class StoredRun(Run):
    """A run in a store, at the version that was the newest when it was opened."""

    def __init__(self, store: Store, entry: Published) -> None:
        self.store, self.entry = store, entry
        home = Path(tempfile.mkdtemp(prefix="jbclog-"))
        weakref.finalize(self, shutil.rmtree, home, ignore_errors=True)
        super().__init__(home / entry.identity.run)
        self._write_files()

    @property
    def place(self) -> str:
        """The run's place in messages and tables."""
        return str(self.entry.found.folder)

    def published(self, table: str) -> pa.Table | None:
        """Return the run's published joints or metrics; None if another version of the rules
        computed them.
        """
        if self.entry.identity.rules != RULES:
            return None
        return pa.concat_tables(
            [OWN[table].empty_table(), *self.store.pieces(table, self.entry, OWN[table].names)]
        )

    def _groups(self, selection: Selection) -> Iterator[pa.Table]:
        pieces = self.store.pieces(
            selection.table, self.entry, selection.needed, _condition(selection)
        )
        return map(selection.cut, pieces)

    def _write_files(self) -> None:
        for name, data in self.store.files_of(self.entry):
            if name == MANIFEST and sha256(data).hexdigest() != self.entry.identity.manifest_sha256:
                raise RecordError(
                    f"{self.place}: its manifest was changed: its SHA-256 is not the one in `runs`"
                )
            self._write(name, data)
        if not (self.folder / MANIFEST).is_file():
            raise RecordError(f"{self.place}: its manifest is not in the store")

    def _write(self, name: str, data: bytes) -> None:
        parts = name.split("/")
        if len(parts) > 2 or not all(map(is_name, parts)):
            raise RecordError(f"{self.place}: has a file {name!r:.100}, which no run has")
        path = self.folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        except OSError as error:
            why = write_failure(error, path)
            raise RecordError(
                f"{self.place}: its file {name!r:.100} cannot be written: {why}"
            ) from error


def _condition(selection: Selection) -> pc.Expression | None:
    """Return the condition by which the statistics of files exclude rows; `Selection.cut` selects
    exactly.
    """
    found = [
        pc.field(name) == value
        for name in ("station", "port")
        if (value := getattr(selection, name)) is not None
    ]
    if selection.start is not None:
        found.append(pc.field("time") >= arrow_time(selection.start))
    if selection.stop is not None:
        found.append(pc.field("time") < arrow_time(selection.stop))
    if not found:
        return None
    both = found[0]
    for one in found[1:]:
        both = both & one
    return both
