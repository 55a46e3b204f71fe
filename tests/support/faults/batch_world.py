"""A world for a executor, made of plain values: its own time, jobs that end as they are told to, a
executor that can be killed.

Every step that a executor does (a line of its journal, a process) is counted, and it can be killed
before and behind each. The jobs go on meanwhile, as processes do.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC
from pathlib import Path

from jbclog.app.batch.executor import BatchExecutor, NullObserver, Timing
from jbclog.app.batch.journal import Journal, iso
from jbclog.app.batch.processes import AttemptResult
from jbclog.app.batch.state import Entry, EntryKind, State, batch_state
from jbclog.config.job_order import Turn, due_times, in_turn
from jbclog.core.outcome import Exit

NIGHT = 1_790_000_000.0
CRASH = "crash"
STILLBORN = "stillborn"  # it dies before its run has a folder
STATES = {0: State.DONE, 1: State.NOT_FINE, 130: State.HALF, 143: State.HALF}


class Killed(BaseException):
    """The executor, with -9."""


@dataclass(frozen=True)
class Fate:
    """What will come of an attempt: an exit code, or how it dies, after so many seconds."""

    comes_to: int | str = 0
    takes_s: float = 10.0


@dataclass
class Process:
    name: str
    attempt: int
    places: frozenset[str]
    fate: Fate
    began: float
    ended: float | None = None
    comes_to: int | str = 0

    @property
    def run(self) -> str:
        return f"run-{self.name}-{self.attempt}"


@dataclass
class World:
    """Time, the processes that there were, and the journal as it stands on disk."""

    turns: list[Turn]
    fates: Callable[[str, int], Fate]
    now: float = NIGHT
    processes: list[Process] = field(default_factory=list)
    disk: list[Entry] = field(default_factory=list)
    steps: int = 0
    kill_at: int | None = None
    wrong: list[str] = field(default_factory=list)
    watch: Callable[[str], None] = lambda name: None

    def __post_init__(self) -> None:
        due = due_times(in_turn(self.turns), self.now, UTC)
        self.disk.append(Entry(iso(self.now), EntryKind.BEGIN, "", asked="night.toml"))
        for turn in self.turns:
            moment = due.get(turn.name)
            entry = Entry(
                iso(self.now),
                EntryKind.JOB,
                "",
                turn.name,
                asked="{}",
                on_failure=turn.on_failure.value,
            )
            self.disk.append(replace(entry, due=None if moment is None else iso(moment)))

    @contextmanager
    def step(self) -> Iterator[None]:
        """Something is done; the executor can be killed before it and behind it."""
        self._count()
        yield
        self._count()

    def _count(self) -> None:
        self.steps += 1
        if self.steps == self.kill_at:
            raise Killed

    def pause(self) -> None:
        """Until something can happen."""
        ends = [process.began + process.fate.takes_s for process in self.running()]
        dues = [
            job.due
            for job in batch_state(self.disk).jobs.values()
            if job.due is not None and job.due > self.now
        ]
        ahead = min([*ends, *dues], default=self.now) - self.now
        self.go_on(max(min(ahead, 5.0) if ends else ahead, 0.25))

    def go_on(self, seconds: float) -> None:
        self.now += seconds
        for process in self.running():
            if process.began + process.fate.takes_s <= self.now:
                process.ended, process.comes_to = self.now, process.fate.comes_to

    def power_cut(self) -> None:
        for process in self.running():
            process.ended, process.comes_to = self.now, CRASH

    def running(self) -> list[Process]:
        return [process for process in self.processes if process.ended is None]

    def process(self, name: str, attempt: int) -> Process | None:
        return next(
            (one for one in self.processes if (one.name, one.attempt) == (name, attempt)), None
        )

    def executor(self) -> BatchExecutor:
        return Whole(
            in_turn(self.turns),
            Memory(self),
            WorldProcesses(self),
            NullObserver(),
            Timing(lambda: self.now, self.pause),
        )


class Whole(BatchExecutor):
    """With what is done when what came of the jobs has been told."""

    def work(self) -> Exit:
        code = super().work()
        self.finish()
        return code


class Memory(Journal):
    """A journal whose disk is a list."""

    def __init__(self, world: World) -> None:
        super().__init__(Path("nowhere"), lambda: world.now)
        self.state = batch_state(world.disk)
        self._world = world

    def note(self, entry: Entry) -> None:
        kept = replace(entry, time=iso(self._world.now))
        with self._world.step():
            self._world.disk.append(kept)
        self.state.take(kept)


class WorldProcesses:
    """Starts processes of the world, and sees what must not be."""

    def __init__(self, world: World) -> None:
        self._world = world

    def start(self, name: str, attempt: int) -> None:
        world = self._world
        places = next(turn.places for turn in world.turns if turn.name == name)
        world.watch(name)
        with world.step():
            for other in world.running():
                if other.places & places:
                    world.wrong.append(f"{name} was started beside {other.name}")
            if any(
                one.comes_to in (0, 1) and one.ended is not None
                for one in world.processes
                if one.name == name
            ):
                world.wrong.append(f"{name} was done already and was started again")
            if world.process(name, attempt) is not None:
                world.wrong.append(f"attempt {attempt} at {name} was started twice")
            world.processes.append(
                Process(name, attempt, places, world.fates(name, attempt), world.now)
            )

    def runs(self, name: str, attempt: int) -> bool:
        process = self._world.process(name, attempt)
        return process is not None and process.ended is None

    def run(self, name: str, attempt: int) -> str | None:
        process = self._world.process(name, attempt)
        return None if process is None or process.fate.comes_to == STILLBORN else process.run

    def request_end(self, name: str, attempt: int, number: signal.Signals) -> bool:
        process = self._world.process(name, attempt)
        if process is not None and process.ended is None:
            process.fate = Fate(
                130 if number is signal.SIGINT else 143, self._world.now + 2.0 - process.began
            )
        return True

    def result(self, name: str, attempt: int) -> AttemptResult | None:
        process = self._world.process(name, attempt)
        with self._world.step():
            if process is None or process.comes_to == STILLBORN:
                return AttemptResult(
                    State.FAILED, Exit.RECORD.value, "its process ended before its run began"
                )
            run = Path(process.run)
            if not isinstance(process.comes_to, int):
                return AttemptResult(
                    State.HALF, Exit.RECORD.value, "its process died while it ran", run
                )
            return AttemptResult(
                STATES.get(process.comes_to, State.FAILED), process.comes_to, "", run
            )
