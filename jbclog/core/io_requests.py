"""The interface between sessions and drivers: requests that a session yields, and results that a
driver sends back.

A session is a generator. It yields a request; a driver (`transport`) carries it out and sends back
an `IoResult`. Where the link breaks, the driver throws `LinkError` into the session at the failed
request; to end a run, or not to start it, `RunEnded`. A session never waits, opens nothing and
never reads a clock.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import NamedTuple, TypeVar


class Ask(NamedTuple):
    """Send `data`; the result is the first bytes that arrive, or none after `patience_s`."""

    data: bytes
    patience_s: float


class Listen(NamedTuple):
    """The result is the next bytes that arrive, or none at `until` (monotonic seconds)."""

    until: float


class Wait(NamedTuple):
    """Sleep until `until` (monotonic seconds); the result is the bytes that arrived meanwhile."""

    until: float


class Reopen(NamedTuple):
    """Close the port and open it again; `LinkError` where that fails."""


START_STEPS = 3
"""Steps of a run's start, at whose ends sessions wait for each other: read and check; write what
cannot heat; the rest.
"""


class Gather(NamedTuple):
    """This session has finished a step of the start; wait until all sessions of the run have.
    `failure`: why it could not.

    `NotStarted` is thrown, here or at an earlier request, where another session failed; `LeftOut`
    where this one is too late.
    """

    step: int
    failure: str = ""


class IoResult(NamedTuple):
    """The result of a request: the moment, the bytes (none: timeout), and when the data of the last
    `Ask` left.

    `late_s`: by how much the driver itself was late, if noticeable. Without it a late driver looks
    like a slow station.
    """

    now: float
    data: bytes
    sent: float
    late_s: float = 0.0


class RunEnded(Exception):
    """Thrown into a session to end it; the session makes its tools safe before it returns."""


class NotStarted(RunEnded):
    """The run does not start because of the other stations that the text names."""


class LeftOut(RunEnded):
    """The run does not wait for this session any longer; the text says how long it did."""


T = TypeVar("T")
Request = Ask | Listen | Wait | Reopen | Gather
Steps = Generator[Request, IoResult, T]
"""A part of a session: yields requests, is sent results, returns a `T`."""


def relay(steps: Steps[T], do: Callable[[Request], Steps[IoResult]]) -> Steps[T]:
    """Pull `steps` and carry out its requests by `do`; an exception of `do` is thrown into `steps`,
    as a driver would.
    """
    try:
        request = next(steps)
        while True:
            try:
                io_result = yield from do(request)
            except Exception as error:
                request = steps.throw(error)
            else:
                request = steps.send(io_result)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        steps.close()
