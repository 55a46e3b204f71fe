"""A pool of child processes, reached by pipes.

Dask's own local cluster listens on a TCP port, through which every user of the computer could run
code as this one. If a child is killed, its tasks are tried again in new children.
"""

from __future__ import annotations

import multiprocessing
import pickle
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from typing import Any, Final, TypeVar

from jbclog.core.errors import RecordError

A = TypeVar("A")
T = TypeVar("T")

AHEAD: Final = 4
"""Tasks per process started ahead; bounds the number of results held."""
MOST_BREAKS: Final = 3


class Processes:
    """Child processes with one thread each; they end with the last result."""

    def __init__(self, count: int) -> None:
        self._count = count

    def run(self, function: Callable[[A], T], tasks: Iterable[A]) -> Iterator[T]:
        """Yield the results in the order of the tasks.

        Raises `RecordError` if children are killed repeatedly.
        """
        packed, left = _packed(function), iter(tasks)
        open_tasks: deque[A] = deque(islice(left, AHEAD * self._count))
        breaks = 0
        while open_tasks:
            try:
                with self._pool() as pool:
                    try:
                        yield from self._results(pool, packed, open_tasks, left)
                    finally:
                        pool.shutdown(wait=True, cancel_futures=True)
            except BrokenProcessPool as error:
                breaks += 1
                if breaks > MOST_BREAKS:
                    raise RecordError(
                        f"processes that read runs were killed {breaks} times, perhaps for lack of"
                        " memory; no answer. In a script, what starts them must stand below `if"
                        ' __name__ == "__main__":`'
                    ) from error

    def _pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._count, multiprocessing.get_context("spawn"), _one_thread)

    def _results(
        self, pool: ProcessPoolExecutor, packed: bytes, open_tasks: deque[A], left: Iterator[A]
    ) -> Iterator[Any]:
        """Yield results; a task leaves `open_tasks` when its result has arrived.

        The result is out before the next task is begun, which fails if a child was killed.
        """
        begun: deque[Future[Any]] = deque(pool.submit(_call, packed, task) for task in open_tasks)
        while begun:
            result = begun.popleft().result()
            open_tasks.popleft()
            yield result
            for task in islice(left, 1):
                open_tasks.append(task)
                begun.append(pool.submit(_call, packed, task))


def _packed(function: Callable[..., object]) -> bytes:
    """Return a function as bytes, with `cloudpickle` (extra `fleet`) also one defined in a
    notebook.
    """
    try:
        import cloudpickle
    except ModuleNotFoundError:
        return pickle.dumps(function)
    return bytes(cloudpickle.dumps(function))


def _call(packed: bytes, task: object) -> object:
    return pickle.loads(packed)(task)


def _one_thread() -> None:
    import pyarrow as pa

    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
