"""Who computes: this process, several processes of this computer, or the workers of a scheduler."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from typing import Final, Protocol, TypeVar

from jbclog.analysis.fleet.processes import Processes
from jbclog.analysis.fleet.scheduler import Scheduler

A = TypeVar("A")
T = TypeVar("T")

MUCH_ROWS: Final = 5_000_000
"""From so many rows on, processes of their own are worth the two seconds that their start takes."""
MUCH_RUNS: Final = 64
"""The same where each run is opened."""


class Engine(Protocol):
    """Calls a function for each task."""

    def run(self, function: Callable[[A], T], tasks: Iterable[A]) -> Iterator[T]:
        """Yield the results in the order of the tasks, whoever computes them; keeps a bounded
        number of them.

        What the function raises is raised here, at the place of its result.
        """
        ...


class Here:
    """This process, one task after another."""

    def run(self, function: Callable[[A], T], tasks: Iterable[A]) -> Iterator[T]:
        return map(function, tasks)


def engine_of(scheduler: str | None, *, is_much: bool) -> Engine:
    """Return who computes: the workers of `scheduler`; without one processes if there is much to
    do, else this process.

    Raises `UsageError` for an address that is none, or without the libraries.
    """
    if scheduler is not None:
        return Scheduler(scheduler)
    count = len(os.sched_getaffinity(0))
    return Processes(count) if is_much and count > 1 else Here()
