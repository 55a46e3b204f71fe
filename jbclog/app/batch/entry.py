"""The lines of a batch's journal: what was decided, before it is done, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Kind(StrEnum):
    """What a line of the journal tells."""

    BEGIN = "begin"  # the batch: its jobs file
    JOB = "job"  # what the file asks of one job, and when it is due
    SITTING = "sitting"  # a process takes the batch up; from here on what was held back or half done is open again
    START = "start"  # a job is about to be started
    RUN = "run"  # its run has a folder
    END = "end"  # it ended: how
    SKIP = "skip"  # it is not done, because one that it waits for was not
    SIGNAL = "signal"  # somebody wants the batch to end
    CLOSE = "close"  # the process gives the batch up: nothing more can begin
    FINISH = "finish"  # every job has come to its end


class State(StrEnum):
    """How a job stands, in the words that people see."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    NOT_FINE = "not fine"  # done and recorded, with a verdict or alarms that are not fine
    FAILED = "failed"
    HALF = "half done"
    SKIPPED = "skipped"


OVER = frozenset({State.DONE, State.NOT_FINE, State.FAILED, State.HALF, State.SKIPPED})
RECORDED = frozenset({State.DONE, State.NOT_FINE})
"""Its run came to the end that was wanted, with its record whole. These are never done again."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A line of the journal; `text` says it to people. What does not belong to its kind is None.

    `again`: the job is open again when the batch is gone on with. `asked` is what the jobs file asks of a job, as JSON.
    """

    time: str
    kind: str
    text: str
    job: str | None = None
    attempt: int | None = None
    state: str | None = None
    again: bool | None = None
    exit_code: int | None = None
    verdict: str | None = None
    run: str | None = None
    due: str | None = None
    asked: str | None = None
    on_failure: str | None = None
    seq: int = 0
    prev_sha256: str = ""
