"""Ends a run at the requested number of units or joints.

The feed of serials (`unit_feed`) counts units. A process beside the recorder (`live/joint_counter`)
counts joints of all stations in the recorded data, as `Run.joints` does afterwards. If the joints
cannot be counted, they end no run. The run ends at the first number reached, some seconds after the
last joint. The manifest has the joints counted again in the whole sealed record.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jbclog.app.run.unit_feed import UnitFeed
from jbclog.core.goal import JOINTS, NOT_COUNTED, UNITS, Goal
from jbclog.core.rows import Severity

if TYPE_CHECKING:
    from jbclog.live.joint_numbers import Counted, JointCounting

LAST_COUNT_S: Final = 120.0
LEAST_PAUSE_S, MOST_PAUSE_S = 1.0, 60.0
LEAST_JOINT_S: Final = 0.5
REST: Final = 9

Note = Callable[[str, str, Severity, float | None], None]
"""Kind, text, severity, value."""


def pause_s(missing: int, ports: int, took_s: float) -> float:
    """Return how long to wait until all missing joints may have been made, at least `REST` times as
    long as a count took.
    """
    soonest = LEAST_JOINT_S * missing / max(ports, 1)
    return max(min(max(soonest, LEAST_PAUSE_S), MOST_PAUSE_S), REST * took_s)


class Goals:
    """The goals of a run. Calls `end` once, with the reason, when a goal is reached; `note` gets
    events for the record.
    """

    def __init__(
        self, goals: Sequence[Goal], note: Note, end: Callable[[str], None], units: UnitFeed | None
    ) -> None:
        self.is_met = False
        self._goals = list(goals)
        self._note = note
        self._end = end
        self._units = units
        self._counting: JointCounting | None = None
        self._joints: int | None = None
        self._ask_at = inf

    def begin(self, folder: Path) -> None:
        """Start to count. Call it when the record has begun."""
        if any(goal.what == JOINTS for goal in self._goals):
            # imported only if needed, because it is slow
            from jbclog.live.joint_numbers import JointCounting

            self._counting = JointCounting(folder)
            self._ask_at = time.monotonic() + LEAST_PAUSE_S  # without requests it counts seldom

    def look(self) -> None:
        """Check the goals. Call it about once a second; never waits."""
        if self._counting is not None:
            self._look_at_joints(self._counting)
        if not self.is_met:
            self._end_when_met()

    def count(self, goal: Goal) -> int | None:
        """Return the latest count for a goal, None if unknown."""
        return self._joints if goal.what == JOINTS else self._finished

    def so_far(self) -> list[Goal]:
        """Return the goals with their latest counts, for display."""
        return [replace(goal, reached=self.count(goal)) for goal in self._goals]

    def reached(self) -> list[Goal]:
        """Return the goals' results, once the record is sealed and the joints are counted."""
        return [
            self._joints_reached(goal) if goal.what == JOINTS else self._units_reached(goal)
            for goal in self._goals
        ]

    def close(self) -> None:
        """Stop counting."""
        if self._counting is not None:
            self._counting.close()
            self._counting = None

    def _look_at_joints(self, counting: JointCounting) -> None:
        if counting.poll() and counting.latest is not None:
            self._joints, ports = counting.latest.found, len(counting.latest.ports)
            missing = max(goal.wanted - self._joints for goal in self._goals if goal.what == JOINTS)
            self._ask_at = time.monotonic() + pause_s(missing, ports, counting.latest.took_s)
        if counting.why is not None:
            self._cannot_count(counting.why)
        elif time.monotonic() >= self._ask_at:
            self._ask_at = inf
            counting.ask()

    @property
    def _finished(self) -> int:
        return 0 if self._units is None else len(self._units.finished)

    def _end_when_met(self) -> None:
        for goal in self._goals:
            count = self.count(goal)
            if count is not None and count >= goal.wanted:
                self.is_met = True
                text = _count_text(goal, count, so_far=goal.what == JOINTS)
                self._note("run.goal", f"{text}; the run ends.", Severity.INFO, count)
                self._end(text)
                return

    def _cannot_count(self, why: str) -> None:
        self.close()
        text = (
            f"Joints can no longer be counted ({why}); the run will not end at the wanted number of"
            " joints."
        )
        self._note("run.uncounted", text, Severity.WARNING, self._joints)

    def _units_reached(self, goal: Goal) -> Goal:
        on_bench = (
            self._units.on_bench_at_end
            if self._units is not None and self._finished < goal.wanted
            else None
        )
        text = f"{_count_text(goal, self._finished)}."
        text += f" Unit {on_bench} was on the bench when the run ended." if on_bench else ""
        return replace(goal, reached=self._finished, text=text)

    def _joints_reached(self, goal: Goal) -> Goal:
        if self._counting is None:
            return replace(goal, text=NOT_COUNTED)
        counted, why = self._counting.last(LAST_COUNT_S), self._counting.why
        self.close()
        if counted is None:
            return replace(goal, text=f"The joints could not be counted: {why}.")
        return replace(
            goal,
            reached=counted.found,
            text=f"{_count_text(goal, counted.found)}{_not_known(counted)}.",
        )


def _not_known(counted: Counted) -> str:
    """Name the ports whose joints are not known."""
    ports = [f"{port.station} port {port.port} ({port.why})" for port in counted.not_known]
    return f"; not known: {', '.join(ports)}" if ports else ""


def _count_text(goal: Goal, count: int, *, so_far: bool = False) -> str:
    """Format a count. `so_far`: provisional, the sealed record may have fewer."""
    done = "finished" if goal.what == UNITS else "found so far (provisional)" if so_far else "found"
    return f"{goal.what.capitalize()} {done}: {count}, wanted: {goal.wanted}"
