"""Opens runs in folders and in stores (`jbclog publish`)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from jbclog.analysis import run as folders
from jbclog.analysis.run import Run
from jbclog.analysis.run_tables import Moment
from jbclog.analysis.runs import Runs, filter_of
from jbclog.analysis.store.place import is_in_store, is_store, place_of
from jbclog.core.errors import RecordError


def open_run(path: str | os.PathLike[str]) -> Run:
    """Open a run: sealed, still being recorded, or cut off by a crash.

    `path` is the run's folder, or ``STORE/RUN`` for a run of a store (`jbclog publish`), which is
    read at the store's newest version. Raises `RecordError` if the run cannot be read.
    """
    given = Path(path)
    if not is_in_store(given):
        return folders.open_run(given)
    from jbclog.analysis.store.reader import Store
    from jbclog.analysis.store.run import StoredRun

    store = Store(place_of(given.parent))
    return StoredRun(store, store.run(given.name))


def open_runs(
    folder: str | os.PathLike[str] = "runs",
    *,
    since: Moment | None = None,
    until: Moment | None = None,
    tags: Mapping[str, str] | None = None,
    **texts: str | None,
) -> Runs:
    """Find the runs below `folder`, or in a store (also ``s3://BUCKET/PATH``), that match all
    conditions.

    - `since`, `until`: start of the run, UTC if without a zone; `since` is included, `until` is not
    - `tags`: names and values that the run must have
    - `texts`: `operator`, `order`, `product`, `unit`, `wire_lot`, `flux_lot`, `tip`, `line`,
      `station`, `recipe` (``NAME`` or ``NAME@REVISION``), `verdict`, `state`; the whole text must
      match, ``*`` stands for any characters

    Raises `UsageError` for an unknown condition, `RecordError` if `folder` does not exist.
    """
    if is_store(folder):
        from jbclog.analysis.store.runs import StoredRuns

        return StoredRuns(place_of(folder), filter_of(since, until, tags, texts))
    path = Path(folder)
    if not path.is_dir():
        raise RecordError(f"{path} is missing, or not a folder")
    return Runs(path, filter_of(since, until, tags, texts))
