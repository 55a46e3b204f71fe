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

from jbclog.analysis.stored_tables import cache_metrics, cached_metrics
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import REPORT, vouch
from jbclog.record.folder import METRICS_CACHE
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
    if (folder / METRICS_CACHE).exists():
        rows = cached_metrics(run, before)
        assert rows, "these metrics are of another run"
        cache_metrics(folder, rows, now)
    return folder


def _write(path: Path, data: bytes) -> None:
    path.unlink()  # a link
    path.write_bytes(data)
