"""One sealed record as many runs, for what is measured over folders of thousands: making each by a
recorder would take hours.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from jbclog.analysis.derived_files import Origin, derived_files, derived_table, write_derived
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import REPORT, vouch
from jbclog.record.folder import DERIVED, DERIVED_TABLES
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import manifest_sha256, manifest_text, read_manifest


def as_another(run: Path, folder: Path, ignore: Iterable[str] = ()) -> Path:
    """A run with the record of `run` and the name of `folder`: links to its files, but for those
    that name the run or its manifest.
    """
    shutil.copytree(
        run, folder, copy_function=os.link, ignore=shutil.ignore_patterns(ANNOTATIONS, *ignore)
    )
    named = manifest_text(replace(read_manifest(run), run=folder.name))
    before, now = manifest_sha256(run), sha256(named.encode()).hexdigest()
    _write(folder / MANIFEST, named.encode())
    if (folder / REPORT).exists():
        report = (run / REPORT).read_bytes().replace(before.encode(), now.encode())
        _write(folder / REPORT, report)
        vouch(folder, sha256(report).hexdigest())
    if (folder / DERIVED).exists():
        every = {name: derived_table(run, name, before) for name in DERIVED_TABLES}
        tables = {name: table for name, table in every.items() if table is not None}
        assert tables, "these tables are of another run"
        shutil.rmtree(folder / DERIVED)  # links
        write_derived(folder, derived_files(tables, Origin.of(folder)))
    return folder


def _write(path: Path, data: bytes) -> None:
    path.unlink()  # a link
    path.write_bytes(data)
