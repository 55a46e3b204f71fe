"""Opens runs in folders."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from jbclog.analysis.run import open_run
from jbclog.analysis.run_tables import Moment
from jbclog.analysis.runs import Runs, filter_of
from jbclog.core.errors import RecordError

__all__ = ["open_run", "open_runs"]


def open_runs(
    folder: str | os.PathLike[str] = "runs",
    *,
    since: Moment | None = None,
    until: Moment | None = None,
    tags: Mapping[str, str] | None = None,
    **texts: str | None,
) -> Runs:
    """Find the runs below `folder` that match all conditions.

    - `since`, `until`: start of the run, UTC if without a zone; `since` is included, `until` is not
    - `tags`: names and values that the run must have
    - `texts`: `operator`, `order`, `product`, `unit`, `wire_lot`, `flux_lot`, `tip`, `line`,
      `station`, `recipe` (``NAME`` or ``NAME@REVISION``), `verdict`, `state`; the whole text must
      match, ``*`` stands for any characters

    Raises `UsageError` for an unknown condition, `RecordError` if `folder` does not exist.
    """
    path = Path(folder)
    if not path.is_dir():
        raise RecordError(f"{path} is missing, or not a folder")
    return Runs(path, filter_of(since, until, tags, texts))
