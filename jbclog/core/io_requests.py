"""The interface between sessions and drivers: a session awaits requests, a driver sends back
results.

A session is a coroutine, without an event loop of its own: what it awaits ends in a request, which
a driver (`transport`) gets from `send`, performs, and answers with an `IoResult` at the next
`send`. The driver throws `LinkError` at the failed request if the link breaks, and `RunEnded` to
end a run or not to start it. A session never waits by itself, opens nothing and reads no clock.
"""

from __future__ import annotations

import types
from collections.abc import Awaitable, Callable, Coroutine, Generator
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
Steps = Coroutine[Request, IoResult | None, T]
"""Part of a session: awaits requests, returns a `T`. Its driver begins with `send(None)`."""


@types.coroutine
def do(request: Request) -> Generator[Request, IoResult, IoResult]:
    """Let the driver perform `request`; return its result. Every `await` of a session ends here."""
    return (yield request)


def ask(data: bytes, patience_s: float) -> Awaitable[IoResult]:
    """Perform an `Ask`, as the four below perform theirs."""
    return do(Ask(data, patience_s))


def listen(until: float) -> Awaitable[IoResult]:
    return do(Listen(until))


def wait(until: float) -> Awaitable[IoResult]:
    return do(Wait(until))


def reopen() -> Awaitable[IoResult]:
    return do(Reopen())


def gather(step: int, failure: str = "") -> Awaitable[IoResult]:
    return do(Gather(step, failure))


async def relay(steps: Steps[T], perform: Callable[[Request], Awaitable[IoResult]]) -> T:
    """Run `steps` and answer its requests with `perform`; throw exceptions of `perform` into
    `steps`, as a driver would.
    """
    try:
        request = steps.send(None)
        while True:
            try:
                io_result = await perform(request)
            except Exception as error:
                request = steps.throw(error)
            else:
                request = steps.send(io_result)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        steps.close()
