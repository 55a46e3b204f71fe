"""What the manifest of a sealed run would list, computed anew from its files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from jbclog.core.rows import TABLES
from jbclog.record.conclude import other_files
from jbclog.record.manifest import SealedFile
from jbclog.record.part_writer import collected, describe_part, write_part
from jbclog.record.parts import part_paths


def files_of(folder: Path) -> Iterator[SealedFile]:
    """Every file of the record with its rows, size and hash."""
    for table in TABLES:
        for path in part_paths(folder, table):
            part = describe_part(path)
            footer = (part.footer_bytes, part.footer_sha256)
            name = path.relative_to(folder).as_posix()
            yield SealedFile(name, part.rows, part.bytes, part.sha256, *footer)
    yield from other_files(folder)


def add_part(folder: Path, table: str, rows: pa.Table) -> None:
    """Write the next part of a table."""
    write_part(folder, table, rows, len(part_paths(folder, table)))


def complete(folder: Path) -> None:
    """Write an empty part for every table without one."""
    for table in TABLES:
        if not part_paths(folder, table):
            add_part(folder, table, collected(table, ()))
