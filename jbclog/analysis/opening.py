"""Opens a run, wherever it is."""

from __future__ import annotations

import os
from pathlib import Path

from jbclog.analysis import run as folders
from jbclog.analysis.published_run import PublishedRun
from jbclog.analysis.run import Run
from jbclog.record.published import Tree, is_published


def open_run(path: str | os.PathLike[str]) -> Run:
    """Open a run: sealed, still being recorded, or cut off by a crash.

    `path` is the run's folder, or ``TABLE/RUN`` for a published run (`jbclog publish`), also
    ``s3://BUCKET/PATH/RUN``. Raises `RecordError` if the run cannot be read.
    """
    given = Path(path)
    if is_published(given):
        return PublishedRun(Tree.at(given.parent), given.name)
    return folders.open_run(given)
