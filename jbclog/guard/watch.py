"""Decide when the guard takes over, from the recorder's lines and their times; watch the recorder's
process.

The recorder sends a line every `RENEW_S`: a station's lease if it changed, else a beat, and an end
when all is done. Further lines, which are no sign of life, carry what `continuity.py` needs. If it
dies, the pipe closes at once; if it hangs, the pipe stays open and silent, and after `HUNG_S` it
counts as hung. A recorder that holds nothing hot may stay silent: it is starting, or sealing. If
the guard itself slept because the whole machine stood still, the recorder gets another `GRACE_S`.
"""

from __future__ import annotations

import os
import select
import signal
import time
from contextlib import suppress
from enum import Enum
from typing import Final

from jbclog.core.json_files import builder, json_of
from jbclog.guard.continuity import Continuity, build_proof
from jbclog.guard.lease import StationLease

RENEW_S: Final = 0.25
HUNG_S: Final = 2.0
GRACE_S: Final = 1.0
OVERSLEPT_S: Final = 0.5  # a guard wakes later than this only if the machine stood still
LOOK_S: Final = 0.01

# lines from the recorder, beside leases
BEAT: Final = "beat"
END: Final = "end"
FAILED: Final = "failed"
# first words of lines about the stations' identities, each before its facts in JSON
FAMILIES: Final = "families"  # their names
PROOF: Final = "proof"
ANSWERED: Final = "answered"  # times by station
DOUBTED: Final = "doubted"  # the station whose proof does not count any more
IDENTITY: Final = frozenset({FAMILIES, PROOF, ANSWERED, DOUBTED})
# bytes from the guard
READY: Final = b"ready\n"
ANSWER: Final = b"."


class GuardLost(Exception):
    """The guard died, hangs or does not read."""


class Verdict(Enum):
    """The guard's next action; the values are parts of sentences."""

    WATCH = "keep watching"
    DONE = "nothing is left to guard"
    DEAD = "the recorder died"
    FAILED = "the recorder failed"
    HUNG = "the recorder did not renew its lease"


_build_families: Final = builder(tuple[str, ...])
_build_times: Final = builder(dict[str, float])


class Watch:
    """A recorder's leases, the identities of its stations, and the time of its last line (monotonic
    seconds).
    """

    def __init__(self, now: float) -> None:
        self.stations: dict[str, StationLease] = {}
        self.continuity = Continuity()
        self.heard_at = now
        self.is_ended = False
        self.has_failed = False
        self._begun = b""

    @property
    def holds(self) -> bool:
        """True if anything has to be made safe."""
        return any(station.holds for station in self.stations.values())

    def hear(self, data: bytes, now: float) -> bool:
        """Take bytes from the pipe in pieces of any size; return True if a lease changed. An
        unknown line is no sign of life.
        """
        *lines, self._begun = (self._begun + data).split(b"\n")
        changed = [self._hear_line(line.decode("utf-8", "replace"), now) for line in lines]
        return any(changed)

    def _hear_line(self, line: str, now: float) -> bool:
        if line.partition(" ")[0] in IDENTITY:
            with suppress(ValueError):
                self._hear_identity(*line.split(" ", 1))
            return False
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

    def _hear_identity(self, kind: str, text: str = "null") -> None:
        known, facts = self.continuity, json_of(text)
        if kind == PROOF:
            known.note_proof(build_proof(facts))
        elif kind == ANSWERED:
            known.note_answers(_build_times(facts))
        elif kind == DOUBTED:
            known.proofs.pop(str(facts), None)
        else:
            known.families = _build_families(facts)

    def overslept(self, late_s: float, now: float) -> None:
        """Register that the guard woke `late_s` later than planned."""
        if late_s > OVERSLEPT_S:
            self.heard_at = max(self.heard_at, now - HUNG_S + GRACE_S)

    def verdict(self, now: float, *, closed: bool) -> Verdict:
        """Return what to do; `closed`: the pipe has lost its writer."""
        if self.is_ended or (closed and not self.holds):
            return Verdict.DONE
        if closed:
            return Verdict.DEAD
        if self.has_failed:
            return Verdict.FAILED if self.holds else Verdict.DONE
        return Verdict.HUNG if self.holds and now - self.heard_at > HUNG_S else Verdict.WATCH

    def patience_s(self, now: float) -> float:
        """Return how long the pipe may stay silent, from `now` on."""
        return max(self.heard_at + HUNG_S - now, 0.0) + 0.01 if self.holds else 3600.0


class Recorder:
    """The process `pid` while it is this process's parent; after that it has died, and another
    process may get its number.

    Without process descriptors (pidfd) the parent's number is polled: it changes when the parent
    dies.
    """

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._descriptor: int | None = None
        with suppress(AttributeError, OSError):
            self._descriptor = os.pidfd_open(pid)
        # checked after opening: the descriptor is certainly the recorder's
        self._is_gone = not self._is_parent

    def end(self, grace_s: float, patience_s: float) -> bool:
        """Kill it after `grace_s` so that it holds no port; return True if it is gone."""
        if self.is_gone_within(grace_s):
            return True
        self._kill()
        return self.is_gone_within(patience_s)

    @property
    def _is_parent(self) -> bool:
        return os.getppid() == self._pid

    def is_gone_within(self, seconds: float) -> bool:
        if self._descriptor is not None and not self._is_gone:
            watched = select.poll()
            watched.register(self._descriptor, select.POLLIN)
            self._is_gone = bool(watched.poll(seconds * 1000))
        end = time.monotonic() + seconds
        while self._descriptor is None and not self._is_gone and time.monotonic() < end:
            time.sleep(LOOK_S)
            self._is_gone = not self._is_parent
        return self._is_gone

    def _kill(self) -> None:
        with suppress(OSError):
            if self._descriptor is not None:
                signal.pidfd_send_signal(self._descriptor, signal.SIGKILL)
            elif self._is_parent:
                os.kill(self._pid, signal.SIGKILL)
