"""A barrier for the sessions of a run at its start: none begins a step before all have finished the
previous member.

A driver has one `Barrier`, with a `Member` for each session. It does no I/O and never resumes a
session directly, but asks the driver to. The rules:

1. A step is over when each session has finished it, failed at it, or was silent for `SILENT_S`
   while all others had finished.
2. If one failed, the run does not start: `NotStarted` is thrown into the others. Up to step two
   this waits for the end of the step, so that every failure is known; in the last step, which heats
   tools, it happens at once.
3. With `allow_missing` the others start without it.
4. Once the run is ending, or the last step is over, no session waits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from jbclog.core.io_requests import START_STEPS, Gather, LeftOut, NotStarted, RunEnded

SILENT_S: Final = 10.0


class Waiting(Protocol):
    """A driver's side of one session."""

    def heard_at(self) -> float:
        """Return when bytes last arrived from its station (monotonic seconds); an earlier moment if
        none ever did.
        """

    def resume(self) -> None:
        """Answer the session's `Gather`."""

    def throw(self, error: RunEnded) -> None:
        """Throw `error` into the session."""


class Member:
    """One session at the barrier."""

    __slots__ = ("failure", "is_out", "is_waiting", "name", "waiting")

    def __init__(self, name: str, waiting: Waiting) -> None:
        self.name = name
        self.waiting = waiting
        self.is_waiting = False  # has finished the step
        self.is_out = False  # has failed, was left out, or has ended
        self.failure = ""


class Barrier:
    """The barrier of a driver's sessions. `now` returns the time, `at` schedules a call in the
    driver's loop, both in monotonic seconds.
    """

    def __init__(
        self,
        now: Callable[[], float],
        at: Callable[[float, Callable[[], None]], object],
        *,
        allow_missing: bool = False,
    ) -> None:
        self._now = now
        self._at = at
        self._allow_missing = allow_missing
        self._members: list[Member] = []
        self._step = 1
        self._last_done = 0.0  # when a session last finished the step or failed at it
        self._is_over = False
        self._is_armed = False

    def join(self, name: str, waiting: Waiting) -> Member:
        member = Member(name or f"session {len(self._members) + 1}", waiting)
        self._members.append(member)
        return member

    def gather(self, member: Member, request: Gather) -> None:
        """Register that `member` has finished a step or failed at it; a failed one does not wait
        for the others.
        """
        if self._is_over:
            self._soon(member.waiting.resume)
            return
        self._last_done = self._now()
        if request.failure:
            self._soon(member.waiting.resume)
            member.is_out = True
            member.failure = request.failure
        else:
            member.is_waiting = True
        self._update()

    def ended(self, member: Member) -> None:
        """Register the end of a session: the others do not wait for it."""
        member.is_out = True
        member.is_waiting = False
        if not self._is_over:
            self._update()

    def disband(self) -> None:
        """Stop all waiting without cancelling the run, because the run is ending."""
        self._is_over = True

    @property
    def _coming(self) -> list[Member]:
        return [member for member in self._members if not (member.is_waiting or member.is_out)]

    @property
    def _failed(self) -> list[Member]:
        return [member for member in self._members if member.failure]

    def _update(self) -> None:
        coming = self._coming
        if self._failed and not self._allow_missing and (self._step == START_STEPS or not coming):
            self._call_off()
        elif coming:
            self._arm()
        else:
            self._pass()

    def _pass(self) -> None:
        waiting = [member for member in self._members if member.is_waiting]
        self._step += 1
        self._is_over = self._step > START_STEPS
        for member in waiting:
            member.is_waiting = False
            self._soon(member.waiting.resume)

    def _call_off(self) -> None:
        self._is_over = True
        names = ", ".join(member.name for member in self._failed)
        for member in self._members:
            if not member.is_out:
                member.is_waiting = False
                self._throw_soon(member, NotStarted(names))

    def _deadline(self) -> float | None:
        """Return the time by which pending sessions have been silent for too long; None if no
        session waits for them.
        """
        coming = self._coming
        if not coming or not any(member.is_waiting or member.failure for member in self._members):
            return None
        return max(self._last_done, *(member.waiting.heard_at() for member in coming)) + SILENT_S

    def _arm(self) -> None:
        deadline = self._deadline()
        if deadline is not None and not self._is_armed:
            self._is_armed = True
            self._at(deadline, self._ring)

    def _ring(self) -> None:
        self._is_armed = False
        deadline = None if self._is_over else self._deadline()
        if deadline is None:
            return
        if self._now() < deadline:
            self._arm()
            return
        for member in self._coming:
            member.is_out = True
            member.failure = (
                f"silent for {SILENT_S:g} s in step {self._step} of the start, while the others"
                " waited"
            )
            self._throw_soon(member, LeftOut(member.failure))
        self._update()

    def _soon(self, call: Callable[[], None]) -> None:
        self._at(self._now(), call)

    def _throw_soon(self, member: Member, error: RunEnded) -> None:
        self._soon(lambda: member.waiting.throw(error))
