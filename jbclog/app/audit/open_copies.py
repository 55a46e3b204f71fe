"""Copies of a run that were made while it was open, as backups are: with another manifest, but not
tampered with.
"""

from __future__ import annotations

import sqlite3
import warnings
from typing import TYPE_CHECKING, Final

from pyarrow import ArrowException

from jbclog.core.errors import JbclogError
from jbclog.record.find_runs import Copy
from jbclog.record.manifest import RunState

if TYPE_CHECKING:
    from jbclog.analysis.run import Run

UNREADABLE: Final = (JbclogError, OSError, ValueError, sqlite3.Error, ArrowException)
"""What reading a run raises that is not as it should be."""
FROM_THE_START: Final = (
    *("run", "schema", "rules", "started", "t0_mono", "t0_utc", "line", "recipes", "metadata"),
    *("host", "rate", "previous"),
)
"""Fields of the manifest that a recorder writes at the start and never changes."""


def was_open(copy: Copy) -> bool:
    """Whether a copy is the counting run as it was before it was sealed: the start is the same, and
    its events are the first ones of that run. Each event has the hash of the one before it, so no
    other record has the same events.

    False if one of the two cannot be read.
    """
    from jbclog.analysis.run import open_run

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an event that is left out is missing below
            return _is_beginning(open_run(copy.folder), open_run(copy.counted))
    except UNREADABLE:
        return False


def _is_beginning(early: Run, sealed: Run) -> bool:
    before, after = early.manifest, sealed.manifest
    if (before.state, after.state) != (RunState.OPEN, RunState.SEALED):
        return False
    if any(getattr(before, name) != getattr(after, name) for name in FROM_THE_START):
        return False
    events = early.events()
    return len(events) > 0 and events.equals(sealed.events().head(len(events)))
