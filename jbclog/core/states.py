"""States of a station and of a tool at the end of a run; values as in the manifest."""

from __future__ import annotations

from enum import StrEnum


class StationOutcome(StrEnum):
    """How a station's part of a run ended."""

    RUNNING = "running"  # not ended, or the record lacks the end
    COMPLETED = "completed"
    STOPPED = "stopped"  # a setting changed during the run
    REFUSED = "refused"  # before sampling
    GONE = "gone"  # no answer at the start or at the end
    NOT_STARTED = "not_started"  # ready, but another station was not
    LEFT_OUT = "left_out"  # not ready, and the run could start without it
    FAILED = "failed"


class SafetyResult(StrEnum):
    """Result of making a touched tool safe."""

    VERIFIED = "verified"  # read back
    SENT = "sent"  # not read back
    FAILED = "failed"
