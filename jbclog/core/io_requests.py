"""What a session wants done, and what it is told: the whole border between knowing and doing.

A session is a generator. It yields one of the wishes below; a driver (`drive/`) does it and sends back a
`Heard`. Where the link breaks, the driver throws `LinkError` into the session at the wish that failed; where
the run is to end, or does not start, `RunEnded`. The session never waits, never opens anything and never asks for the time.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import NamedTuple, TypeVar


class Ask(NamedTuple):
    """Send `data`, then give the first bytes that come, or none once `patience_s` is over."""

    data: bytes
    patience_s: float


class Listen(NamedTuple):
    """Give the next bytes that come, or none at `until` (monotonic seconds)."""

    until: float


class Wait(NamedTuple):
    """Sleep until `until` (monotonic seconds); give the bytes that came unasked meanwhile."""

    until: float


class Reopen(NamedTuple):
    """Close the port and open it again; `LinkError` comes back where that fails."""


START_STEPS = 3
"""Of a run's start, between which its sessions wait for each other: read and check; write what cannot heat; what can."""


class Gather(NamedTuple):
    """This session has done a step of the start: go on once all of the run's sessions have. `failure`: it could not, and why.

    `NotStarted` comes back, here or at a wish before, where another failed; `LeftOut` where the others waited for this one in vain.
    """

    step: int
    failure: str = ""


class Heard(NamedTuple):
    """What came back: the moment, the bytes (none: the time was over), and when the question left.

    `late_s`: for how long the driver itself did not come round meanwhile, where it was noticeable. An answer that waited so
    long to be heard, and one that the station took so long to give, look the same otherwise.
    """

    now: float
    data: bytes
    sent: float
    late_s: float = 0.0


class RunEnded(Exception):
    """Thrown into a session to end it. It still puts its tools in their safe state before it returns."""


class NotStarted(RunEnded):
    """The run does not start because of other stations, which the text names."""


class LeftOut(RunEnded):
    """The run starts, or not, without this session, which the others have waited for; the text says how long."""


T = TypeVar("T")
Request = Ask | Listen | Wait | Reopen | Gather
Steps = Generator[Request, Heard, T]
"""A piece of a session: yields wishes, is sent what was heard, returns a `T`."""


def relay(steps: Steps[T], do: Callable[[Request], Steps[Heard]]) -> Steps[T]:
    """Pull `steps`, and have `do` see to each of its wishes. What goes wrong in that is for the steps, as from a driver."""
    try:
        wish = next(steps)
        while True:
            try:
                heard = yield from do(wish)
            except Exception as error:
                wish = steps.throw(error)
            else:
                wish = steps.send(heard)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        steps.close()
