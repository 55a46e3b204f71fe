"""A published run (`record/published.py`) as `Run`: code that reads the folder of a run also reads
this one.

Its small files (manifest, annotations, line, recipes, what was derived) are copied to a temporary
folder, which is removed with the object. Tables are read where they are, only the columns and the
row groups that are needed.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import BinaryIO, cast

import pandas as pd
import pyarrow as pa

from jbclog.analysis.run import Run
from jbclog.analysis.run_tables import Selection, select
from jbclog.core.errors import RecordError
from jbclog.core.rows import TABLES
from jbclog.record.folder import derived_file
from jbclog.record.manifest import SealedFile
from jbclog.record.part_file import PartFile, sealed_footer
from jbclog.record.parts import group_of
from jbclog.record.published import MADE_LATER, Tree, explained, fetch, key_of
from jbclog.record.samples_by_port import Part, SamplesByPort
from jbclog.record.schema import CAPTURE

READ_IN_PLACE = (*(f"{table}/" for table in TABLES), f"{CAPTURE}/")
DERIVED = tuple(derived_file(table) for table in ("joints", "units", "metrics"))
"""Derived tables that are read instead of the samples."""


class PublishedRun(Run):
    """A run in a published tree."""

    def __init__(self, tree: Tree, run: str) -> None:
        """Raises `RecordError` if the run is not published, or its manifest cannot be read."""
        self.tree = tree
        home = Path(tempfile.mkdtemp(prefix="jbclog-"))
        weakref.finalize(self, shutil.rmtree, home, ignore_errors=True)
        super().__init__(fetch(tree, run, home, _is_small))

    @property
    def place(self) -> str:
        """Where the run is, as messages show it: ``TABLE/RUN``."""
        return f"{self.tree}/{self.name}"

    def samples_by_port(self, columns: Sequence[str]) -> SamplesByPort:
        """Return these columns of the samples port by port, in the order of the line file."""
        selection = select("samples", columns)
        parts = [
            Part(partial(open_published_part, self.tree, key_of(self.name, file.path), file), True)
            for file in self._files_of("samples")
        ]
        order = [(facts.name, port) for facts in self.stations for port in facts.ports]
        return SamplesByPort(selection.columns, parts, order=order)

    def _groups(self, selection: Selection) -> Iterator[pa.Table]:
        table = selection.table
        for file in self._files_of(table):
            with open_published_part(self.tree, key_of(self.name, file.path), file) as part:
                for index in range(part.num_row_groups):
                    if may_have(part, index, selection):
                        yield selection.cut(group_of(part, table, index, selection.needed))

    def _files_of(self, table: str) -> list[SealedFile]:
        return [file for file in self.manifest.files if file.path.startswith(f"{table}/")]


def _is_small(name: str) -> bool:
    """Whether a file is copied, because it is read whole."""
    if name in MADE_LATER:
        return name in DERIVED
    return not name.startswith(READ_IN_PLACE)


def may_have(part: PartFile, index: int, selection: Selection) -> bool:
    """Whether a row group can have selected rows, by the bounds in the footer."""
    if not part.may_have(index, selection.station, selection.port):
        return False
    names = part.schema.names
    statistics = part.metadata.row_group(index).column(names.index("time")).statistics
    if statistics is None or not statistics.has_min_max:
        return True
    return _overlap(selection, statistics.min, statistics.max)


def _overlap(selection: Selection, least: pd.Timestamp, most: pd.Timestamp) -> bool:
    begins_later = selection.stop is not None and least >= selection.stop
    ends_before = selection.start is not None and most < selection.start
    return not begins_later and not ends_before


@contextmanager
def open_published_part(tree: Tree, key: str, seal: SealedFile) -> Iterator[PartFile]:
    """Open a part by its footer, which must agree with `seal`, its entry in the manifest. Raises
    `RecordError`.
    """
    with explained(tree):
        try:
            file = tree.files().open_input_file(key)
        except FileNotFoundError:
            raise RecordError(
                f"{tree}/{key} is missing; `jbclog publish` copies it again"
            ) from None
    with file:
        try:
            footer = sealed_footer(Path(tree.url, key), cast(BinaryIO, file), seal)
        except OSError as error:
            raise RecordError(f"{tree}/{key} {error}") from error
        part = PartFile(file, footer, f"{tree}/{key}")
        try:
            yield part
        finally:
            part.close()
