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
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import BinaryIO, cast

import pandas as pd
import pyarrow as pa

from jbclog.analysis.run import Run
from jbclog.analysis.run_tables import Selection
from jbclog.core.errors import RecordError
from jbclog.core.rows import TABLES
from jbclog.record.capture import FOLDER as CAPTURES
from jbclog.record.capture import wire_path
from jbclog.record.manifest import SealedFile
from jbclog.record.part_file import PartFile, sealed_footer
from jbclog.record.parts import group_of
from jbclog.record.published import Tree, explained, fetch, key_of

READ_IN_PLACE = (*(f"{table}/" for table in TABLES), f"{CAPTURES}/")


class PublishedRun(Run):
    """A run in a published tree."""

    def __init__(self, tree: Tree, run: str) -> None:
        """Raises `RecordError` if the run is not published, or its manifest cannot be read."""
        self.tree = tree
        home = Path(tempfile.mkdtemp(prefix="jbclog-"))
        weakref.finalize(self, shutil.rmtree, home, ignore_errors=True)
        super().__init__(fetch(tree, run, home, lambda name: not name.startswith(READ_IN_PLACE)))

    @property
    def place(self) -> str:
        """Where the run is, as messages show it: ``TABLE/RUN``."""
        return f"{self.tree}/{self.name}"

    def wire(self, station: str) -> pd.DataFrame:
        """Return the serial capture of a station, as `Run.wire` does; it is copied first."""
        capture = wire_path(self.folder, station).relative_to(self.folder).as_posix()
        if any(file.path == capture for file in self.manifest.files):
            with tempfile.TemporaryDirectory(prefix="jbclog-") as home:
                return Run(fetch(self.tree, self.name, Path(home), capture.__eq__)).wire(station)
        return super().wire(station)

    def _groups(self, selection: Selection) -> Iterator[pa.Table]:
        table = selection.table
        numbers = count()
        listed = [file for file in self.manifest.files if file.path.startswith(f"{table}/")]
        for file in listed:
            with open_published_part(self.tree, key_of(self.name, file.path), file) as part:
                for index in range(part.num_row_groups):
                    is_wanted = selection.wanted is None or selection.wanted(next(numbers))
                    if is_wanted and may_have(part, index, selection):
                        yield selection.cut(group_of(part, table, index, selection.needed))


def may_have(part: PartFile, index: int, selection: Selection) -> bool:
    """Whether a row group can have selected rows, by the bounds in the footer."""
    group = part.metadata.row_group(index)
    for place, name in enumerate(part.schema.names):
        statistics = group.column(place).statistics
        if statistics is None or not statistics.has_min_max:
            continue
        least, most = statistics.min, statistics.max
        wanted = {"station": selection.station, "port": selection.port}.get(name)
        if wanted is not None and not least <= wanted <= most:
            return False
        if name == "time" and not _overlap(selection, least, most):
            return False
    return True


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
