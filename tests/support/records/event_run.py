"""A small run, written through the real store, in which these events were told."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jbclog.core.rows import EventRow, Severity
from jbclog.record.conclude import conclude
from jbclog.record.manifest import Manifest, Metadata, read_manifest, write_manifest
from jbclog.record.seal import seal_journal
from support.records import few_rows
from support.records.few_rows import T0

Told = tuple[int, str, str | None]
"""Second, kind, and what stands in `raw`."""


def run_with(out: Path, told: Sequence[Told], metadata: Metadata, *, crashes: bool = False) -> Path:
    """The run's folder: sealed, or as a recorder leaves it that is gone."""
    store = few_rows.begun(out)
    write_manifest(store.folder, Manifest(store.folder.name, metadata=metadata))
    for second, kind, raw in told:
        store.event(
            EventRow(T0 + second * 1_000_000, kind, Severity.INFO, kind, raw=raw), at_once=True
        )
    store.commit_now()
    if crashes:
        few_rows.vanish(store)
        return store.folder
    store.close()
    seal_journal(store.folder)
    conclude(store.folder, read_manifest(store.folder), store.lock)
    return store.folder
