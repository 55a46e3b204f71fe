"""Capture the traffic of a port and the results of its session, and replay a session from them.

`captured` wraps a session and keeps the results of its requests; `replayed` sends it the same
results without a port. The replayed session produces the same rows, times included.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Literal, NamedTuple, Self, TypeVar

from jbclog.core.capture_rows import CaptureRow, LinkRow, RequestName, ResultKind, ResultRow
from jbclog.core.errors import LinkError
from jbclog.core.io_requests import (
    Ask,
    Gather,
    IoResult,
    LeftOut,
    Listen,
    NotStarted,
    Reopen,
    Request,
    RunEnded,
    Steps,
    Wait,
    do,
    wait,
)
from jbclog.transport.port import Port, unread

KeepLinkRow = Callable[[LinkRow], object]


class Tee:
    """A `Port` around a port that passes every byte and every change of the link to `keep`, with
    its time.

    The thread that moves the bytes calls `keep`, so it must be quick, such as a bounded deque's
    `append`. A request is kept before it is written, so that it precedes its answer. `close` keeps
    the number of unread bytes.
    """

    def __init__(
        self, port: Port, keep: KeepLinkRow, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._port = port
        self._keep = keep
        self._now = now
        self._is_there = True

    @classmethod
    def opened(
        cls,
        open_port: Callable[[], Port],
        keep: KeepLinkRow,
        now: Callable[[], float] = time.monotonic,
    ) -> Self:
        """Open a port and keep the result; a failure is raised unchanged."""
        try:
            port = open_port()
        except LinkError as error:
            keep(LinkRow(now(), "failed", text=str(error)))
            raise
        keep(LinkRow(now(), "opened", text=port.url))
        return cls(port, keep, now)

    @property
    def url(self) -> str:
        return self._port.url

    def fileno(self) -> int | None:
        return self._port.fileno()

    def write(self, data: bytes) -> None:
        self._keep(LinkRow(self._now(), "sent", data))
        try:
            self._port.write(data)
        except LinkError as error:
            self._end("lost", str(error))
            raise

    def read_now(self) -> bytes:
        return self._heard(self._port.read_now)

    def read(self, timeout_s: float) -> bytes:
        return self._heard(lambda: self._port.read(timeout_s))

    def close(self) -> None:
        left = unread(self._port.fileno()) if self._is_there else 0
        self._end("closed", f"{left} bytes that had come were not read" if left else "")
        self._port.close()

    def _heard(self, read: Callable[[], bytes]) -> bytes:
        try:
            data = read()
        except LinkError as error:
            self._end("lost", str(error))
            raise
        if data:
            self._keep(LinkRow(self._now(), "heard", data))
        return data

    def _end(self, how: Literal["lost", "closed"], text: str = "") -> None:
        """Keep the end of the link, once: a lost port is closed as well."""
        if self._is_there:
            self._is_there = False
            self._keep(LinkRow(self._now(), how, text=text))


T = TypeVar("T")

REQUEST_NAMES: dict[type[Request], RequestName] = {
    Ask: "ask",
    Listen: "listen",
    Wait: "wait",
    Reopen: "reopen",
    Gather: "gather",
}
RESULT_OF_ERROR: dict[type[Exception], ResultKind] = {
    LinkError: "broke",
    RunEnded: "stopped",
    NotStarted: "not_started",
    LeftOut: "left_out",
}
ERROR_OF_RESULT = {result: error for error, result in RESULT_OF_ERROR.items()}
ROUNDING_S = 1e-6  # tolerance between a result's time and its deadline

KeepResult = Callable[[ResultRow], object]


async def captured(steps: Steps[T], keep: KeepResult, now: Callable[[], float]) -> T:
    """Run `steps` and pass every result to `keep` before `steps` receives it."""
    last = 0.0
    try:
        request = steps.send(None)
        while True:
            name = REQUEST_NAMES[type(request)]
            try:
                heard = await do(request)
            except (LinkError, RunEnded) as error:
                kind = RESULT_OF_ERROR.get(type(error), "broke")
                keep(ResultRow(now(), kind, name, text=str(error)))
                request = steps.throw(error)
            else:
                last = heard.now
                keep(
                    ResultRow(last, "told", name, len(heard.data), heard.sent, late_s=heard.late_s)
                )
                request = steps.send(heard)
    except StopIteration as end:
        keep(ResultRow(max(last, now()), "done", "wait"))
        result: T = end.value
        return result


class ReplayStep(NamedTuple):
    """Result of one request, with the data sent for it, if any, and the bytes received."""

    result: ResultRow
    asked: bytes
    data: bytes

    def __str__(self) -> str:
        if self.result.what == "done":
            return "the end"
        if self.asked:
            return f"{self.result.request} {self.asked!r}"
        return self.result.request

    def answers(self, request: Request) -> bool:
        """Return True if this can be the result of `request`."""
        result = self.result
        is_told = result.what == "told"
        if result.what == "done" or REQUEST_NAMES[type(request)] != result.request:
            return False
        if isinstance(request, Ask) and self.asked != request.data:
            return not self.asked and not is_told  # it could not even be sent
        if is_told and not self.data:
            return result.at_s >= self._deadline(request) - ROUNDING_S
        return True

    def _deadline(self, request: Request) -> float:
        """Return the moment before which a result without bytes is impossible."""
        if isinstance(request, Ask):
            return self.result.sent_s + request.patience_s
        return request.until if isinstance(request, Listen | Wait) else 0.0


def replay_steps(rows: Iterable[CaptureRow]) -> Iterator[ReplayStep]:
    """Group the rows of a capture into the results that its session received, in order."""
    asked = b""
    came = b""
    for row in rows:
        if isinstance(row, ResultRow):
            yield ReplayStep(row, asked, came[: row.size])
            asked = b""
            came = came[row.size :]
        elif row.what == "sent":
            asked = row.data
        elif row.what == "heard":
            came += row.data
        elif row.what == "opened":
            came = b""  # unread bytes of the previous port are lost with it


class Divergence(NamedTuple):
    """The point where a session departed from its capture: its request, and the recorded result
    that does not fit (None: none is left).
    """

    at_s: float
    request: Request
    step: ReplayStep | None

    def __str__(self) -> str:
        request: str = REQUEST_NAMES[type(self.request)]
        if isinstance(self.request, Ask):
            request = f"{request} {self.request.data!r}"
        if self.step is None:
            return f"it would {request}; recorded is nothing more"
        return f"it would {request}; recorded is {self.step}"

    @property
    def is_cut_off(self) -> bool:
        """True if the capture ended before its session did."""
        return self.step is None


OnDivergence = Callable[[Divergence], object]
"""Called when a session departs from its capture, or its capture ends before it does."""


async def replayed(steps: Steps[T], tape: Iterable[ReplayStep], left: OnDivergence) -> T | None:
    """Run `steps` on the results in `tape`. The driver sees only waits, so that its clock keeps
    pace.

    If a request does not match the capture, or the capture ends first, calls `left`, abandons the
    session and returns None.
    """
    try:
        now = 0.0
        request = steps.send(None)
        for step in tape:
            if not step.answers(request):
                left(Divergence(now, request, step))
                return None
            now = step.result.at_s
            await wait(now)
            request = _send(steps, step)
    except StopIteration as end:
        result: T = end.value
        return result
    left(Divergence(now, request, None))
    return None


def _send(steps: Steps[T], step: ReplayStep) -> Request:
    result = step.result
    error = ERROR_OF_RESULT.get(result.what)
    if error is not None:
        return steps.throw(error(result.text))
    return steps.send(IoResult(result.at_s, step.data, result.sent_s, result.late_s))
