"""When the guard takes over: pure arithmetic of what the recorder said and when.

The recorder sends a line each `RENEW_S`: a station's lease where it changed, a beat where nothing did, an end when all
is done. Its death closes the pipe at once; while it hangs the pipe stays open and silent, and after `HUNG_S` it counts
as hung. A recorder that holds nothing hot may be as silent as it likes: it is starting, or sealing. A silence that the
guard has slept through itself, because the whole machine stood still, is nobody's fault: then the recorder gets
`GRACE_S` to say something.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from jbclog.guard.lease import StationLease

RENEW_S: Final = 0.25
HUNG_S: Final = 2.0
GRACE_S: Final = 1.0
OVERSLEPT_S: Final = 0.5  # so late no guard wakes on a machine that goes on
BEAT: Final = "beat"
END: Final = "end"
FAILED: Final = "failed"


class Verdict(Enum):
    WATCH = "go on watching"
    DONE = "nothing is left to guard"
    DEAD = "the recorder died"
    FAILED = "the recorder failed"
    HUNG = "the recorder did not renew its lease"


class Watch:
    """What one recorder has leased, and when it was last heard of (monotonic seconds)."""

    def __init__(self, now: float) -> None:
        self.stations: dict[str, StationLease] = {}
        self.heard_at = now
        self.is_ended = False
        self.has_failed = False
        self._begun = b""

    @property
    def holds(self) -> bool:
        """Whether anything would have to be made safe."""
        return any(station.holds for station in self.stations.values())

    def hear(self, data: bytes, now: float) -> bool:
        """Take in bytes of the pipe, however they are cut; whether a lease changed. What is no line of ours is not a sign
        of life either.
        """
        *lines, self._begun = (self._begun + data).split(b"\n")
        changed = [self._hear_line(line.decode("utf-8", "replace"), now) for line in lines]
        return any(changed)

    def _hear_line(self, line: str, now: float) -> bool:
        is_lease = line not in (BEAT, END, FAILED)
        if is_lease:
            try:
                station = StationLease.from_json(line)
            except ValueError:
                return False
            self.stations[station.name] = station
        self.is_ended |= line == END
        self.has_failed |= line == FAILED
        self.heard_at = now
        return is_lease

    def overslept(self, late_s: float, now: float) -> None:
        """The guard woke `late_s` after it wanted to."""
        if late_s > OVERSLEPT_S:
            self.heard_at = max(self.heard_at, now - HUNG_S + GRACE_S)

    def verdict(self, now: float, *, closed: bool) -> Verdict:
        """What to do now; `closed`: the pipe has no writer any more."""
        if self.is_ended or (closed and not self.holds):
            return Verdict.DONE
        if closed:
            return Verdict.DEAD
        if self.has_failed:
            return Verdict.FAILED if self.holds else Verdict.DONE
        return Verdict.HUNG if self.holds and now - self.heard_at > HUNG_S else Verdict.WATCH

    def patience_s(self, now: float) -> float:
        """How long the pipe may be silent from `now` on before there is something to decide."""
        return max(self.heard_at + HUNG_S - now, 0.0) + 0.01 if self.holds else 3600.0
