"""The interface between sessions and drivers: a session yields requests, a driver sends back
results.

A session is a generator. It yields a request; a driver (`transport`) performs it and sends back an
`IoResult`. The driver throws `LinkError` at the failed request if the link breaks, and `RunEnded`
to end a run or not to start it. A session never waits, opens nothing and reads no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import NamedTuple, TypeVar


class Ask(NamedTuple):
    """Send `data`; the result is the first bytes that arrive, or none after `patience_s`."""

    data: bytes
    patience_s: float


class Listen(NamedTuple):
    """Wait for the next bytes; the result is empty at `until` (monotonic seconds)."""

    until: float


class Wait(NamedTuple):
    """Sleep until `until` (monotonic seconds); the result is the bytes that arrived meanwhile."""

    until: float


class Reopen(NamedTuple):
    """Close the port and open it again; throws `LinkError` on failure."""


START_STEPS = 3
"""Steps of a run's start; sessions wait for each other after each: read and check, write what
cannot heat, write the rest.
"""


class Gather(NamedTuple):
    """This session has finished a step of the start, or failed (`failure` says why); wait for all
    other sessions.

    Throws `NotStarted`, here or at an earlier request, if another session failed, and `LeftOut` if
    this one is too late.
    """

    step: int
    failure: str = ""


class IoResult(NamedTuple):
    """Result of a request: the time, the bytes (none: timeout), and when the data of the last `Ask`
    left.

    `late_s`: how late the driver itself was, if noticeable. Without it a late driver looks like a
    slow station.
    """

    now: float
    data: bytes
    sent: float
    late_s: float = 0.0


class RunEnded(Exception):
    """Thrown into a session to end it; the session makes its tools safe before it returns."""


class NotStarted(RunEnded):
    """The run does not start because of other stations, named in the text."""


class LeftOut(RunEnded):
    """The run no longer waits for this session; the text says how long it did."""


T = TypeVar("T")
Request = Ask | Listen | Wait | Reopen | Gather
Steps = Generator[Request, IoResult, T]
"""Part of a session: yields requests, receives results, returns a `T`."""


def relay(steps: Steps[T], do: Callable[[Request], Steps[IoResult]]) -> Steps[T]:
    """Run `steps` and perform its requests with `do`; throw exceptions of `do` into `steps`, as a
    driver would.
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
