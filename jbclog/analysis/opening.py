"""Opens runs wherever they are: in folders, or in a store that `jbclog publish` filled."""

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
    """Return the run in the folder `path`: sealed, still being recorded, or cut off by a crash.
    Raises `RecordError`.

    ``STORE/RUN`` is a run of a store (`jbclog publish`), read at its newest version.
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
    """Return the runs below `folder`, or in the store `folder` (also ``s3://BUCKET/PATH``), that
    match all conditions.

    `texts` are `operator`, `order`, `product`, `unit`, `wire_lot`, `flux_lot`, `tip`, `line`,
    `station`, `recipe` (``NAME`` or ``NAME@REVISION``), `verdict`, `state`; each matches as a
    whole, ``*`` stands for any characters. A run starts at `since` or later and before `until`, UTC
    without a zone. Raises `UsageError` for an unknown condition, `RecordError` without the folder.
    """
    if is_store(folder):
        from jbclog.analysis.store.runs import StoredRuns

        return StoredRuns(place_of(folder), filter_of(since, until, tags, texts))
    path = Path(folder)
    if not path.is_dir():
        raise RecordError(f"{path} is missing, or not a folder")
    return Runs(path, filter_of(since, until, tags, texts))
