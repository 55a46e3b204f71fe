"""Ends a run when it has recorded the requested number of units or joints.

The feed of serials (`unit_feed`) counts units. A process beside the recorder (`joint_counter`) counts joints of all stations in
the recorded data, as `Run.joints` does afterwards. If the joints cannot be counted, they end no run. The run ends at the first
number reached, some seconds after the last joint. The manifest has the joints counted once more in the whole sealed record.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

from jbclog.app.run.unit_feed import UnitFeed
from jbclog.core.rows import JOINTS, NOT_COUNTED, UNITS, Goal, Severity

LOOK_EVERY_S: Final = 1.0
LAST_COUNT_S: Final = 120.0
KILL_S: Final = 0.5

Note = Callable[[str, str, Severity, float | None], None]
"""Kind, text, severity, value."""


class Uncounted(Exception):
    """The joints cannot be counted."""


class JointCount:
    """The process that counts the joints of the run in `folder`. Raises `Uncounted` if it cannot start or has ended."""

    def __init__(self, folder: Path, wanted: int) -> None:
        command = [sys.executable, "-P", "-m", "jbclog.app.run.joint_counter", str(folder), str(wanted)]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # after Ctrl-C the run still needs its last count
                bufsize=0,
            )
        except OSError as error:
            raise Uncounted(str(error)) from error
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._asking, self._answers = self._process.stdin, self._process.stdout.fileno()
        os.set_blocking(self._answers, False)
        self._rest = b""

    def look(self) -> int | None:
        """Return the latest count, None if there is no new one. Never waits. Raises `Uncounted`."""
        counts = [self._number(line) for line in self._lines()]
        return counts[-1] if counts else None

    def last(self) -> int:
        """Return the joints in the sealed record; waits `LAST_COUNT_S` at most. Raises `Uncounted`."""
        try:
            self._asking.write(b"\n")
            while True:
                if not select.select([self._answers], [], [], LAST_COUNT_S)[0]:
                    raise Uncounted(f"it took more than {LAST_COUNT_S:g} s")
                for line in self._lines():
                    if line.startswith("="):
                        return self._number(line.removeprefix("="))
                    self._number(line)
        except OSError as error:
            raise Uncounted(error.strerror or str(error)) from error
        finally:
            self.close()

    def close(self) -> None:
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(KILL_S)
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()

    def _lines(self) -> list[str]:
        try:
            data = os.read(self._answers, 4096)
        except BlockingIOError:
            return []
        if not data:
            raise Uncounted("the process that counts them ended")
        *lines, self._rest = (self._rest + data).split(b"\n")
        return [line.decode(errors="replace") for line in lines]

    @staticmethod
    def _number(line: str) -> int:
        if line.startswith("!"):
            raise Uncounted(line.removeprefix("!").strip())
        return int(line)


class Goals:
    """The goals of a run. Calls `end` once, with the reason, when one of them is reached; `note` with events for the record."""

    def __init__(self, goals: Sequence[Goal], note: Note, end: Callable[[str], None], units: UnitFeed | None) -> None:
        self.is_met = False
        self._goals = list(goals)
        self._note = note
        self._end = end
        self._units = units
        self._counter: JointCount | None = None
        self._joints: int | None = None

    def begin(self, folder: Path) -> None:
        """Start to count. Call it when the record has begun."""
        for goal in self._goals:
            if goal.what == JOINTS:
                try:
                    self._counter = JointCount(folder, goal.wanted)
                except Uncounted as why:
                    self._cannot_count(why)

    def look(self) -> None:
        """Check the goals. Call it about once a second; never waits."""
        try:
            found = None if self._counter is None else self._counter.look()
        except Uncounted as why:
            self._cannot_count(why)
        else:
            self._joints = self._joints if found is None else found
        if not self.is_met:
            self._end_when_met()

    def count(self, goal: Goal) -> int | None:
        """Return the latest count for a goal, None if unknown."""
        return self._joints if goal.what == JOINTS else self._finished

    def so_far(self) -> list[Goal]:
        """Return the goals with their latest counts, for who shows the run."""
        return [replace(goal, reached=self.count(goal)) for goal in self._goals]

    def reached(self) -> list[Goal]:
        """Return the goals with their results, once the record is sealed. Waits until the joints are counted."""
        return [self._joints_reached(goal) if goal.what == JOINTS else self._units_reached(goal) for goal in self._goals]

    def close(self) -> None:
        """Stop counting."""
        if self._counter is not None:
            self._counter.close()
            self._counter = None

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

    def _cannot_count(self, why: Uncounted) -> None:
        self.close()
        text = f"The joints of this run cannot be counted any more ({why}); it will not be ended by their number."
        self._note("run.uncounted", text, Severity.WARNING, self._joints)

    def _units_reached(self, goal: Goal) -> Goal:
        on_bench = self._units.on_bench_at_end if self._units is not None and self._finished < goal.wanted else None
        text = f"{_count_text(goal, self._finished)}."
        text += f" Unit {on_bench} was on the bench when the run ended." if on_bench else ""
        return replace(goal, reached=self._finished, text=text)

    def _joints_reached(self, goal: Goal) -> Goal:
        if self._counter is None:
            return replace(goal, text=NOT_COUNTED)
        try:
            count = self._counter.last()
        except Uncounted as why:
            return replace(goal, text=f"How many joints there are could not be counted: {why}.")
        finally:
            self._counter = None
        return replace(goal, reached=count, text=f"{_count_text(goal, count)}.")


def _count_text(goal: Goal, count: int, *, so_far: bool = False) -> str:
    """Format a count. `so_far`: provisional, the sealed record may have fewer."""
    done = "finished" if goal.what == UNITS else "found so far (provisional)" if so_far else "found"
    return f"{goal.what.capitalize()} {done}: {count}, wanted: {goal.wanted}"
