"""Where to compute: in this process, in several processes of this computer, or on the workers of a
scheduler.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from typing import Final, Protocol, TypeVar

from jbclog.analysis.fleet.processes import Processes
from jbclog.analysis.fleet.scheduler import Scheduler

A = TypeVar("A")
T = TypeVar("T")

MUCH_ROWS: Final = 5_000_000
"""Rows from which on child processes are worth the two seconds that their start takes."""
MUCH_RUNS: Final = 64
"""The same as a number of runs, where each run is opened."""


class Engine(Protocol):
    """Calls a function for each task."""

    def run(self, function: Callable[[A], T], tasks: Iterable[A]) -> Iterator[T]:
        """Yield the results in the order of the tasks, holding a bounded number of them.

        An exception of the function is raised at the position of its result.
        """
        ...


class Here:
    """Runs one task after another in this process."""

    def run(self, function: Callable[[A], T], tasks: Iterable[A]) -> Iterator[T]:
        return map(function, tasks)


def engine_of(scheduler: str | None, *, is_much: bool) -> Engine:
    """Return the engine: the workers of `scheduler`; without one, processes if there is much to do,
    else this process.

    Raises `UsageError` for an invalid address, or without the libraries.
    """
    if scheduler is not None:
        return Scheduler(scheduler)
    count = len(os.sched_getaffinity(0))
    return Processes(count) if is_much and count > 1 else Here()
