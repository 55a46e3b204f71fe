"""What passed through a port and what its session was told, kept so that it can be lived through again.

`keeping` wraps a session and notes what it is told; `reliving` tells it the same, to the bit, without any port. The two
are each other's inverse: the second life gives the same rows, times included.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from math import inf
from typing import Literal, NamedTuple, Self, TypeVar

from jbclog.core.errors import LinkError
from jbclog.core.io_requests import Ask, Gather, Heard, LeftOut, Listen, NotStarted, Reopen, Request, RunEnded, Steps, Wait
from jbclog.core.wire import Passed, Row, Told, ToldName, WishName
from jbclog.transport.port import Port, unread

# -- tee ----------------------------------------------------------------------------------------------------------------------
# A port that notes what passes through it: every byte with its moment and direction, and every change of the link.

KeepWire = Callable[[Passed], object]


class Tee:
    """A `Port` around a port. `keep` is called in the thread that moves the bytes: a bounded deque's `append`.

    A question is noted before it is handed over, so that it stands before its answer whoever reads that. What was read is noted
    to the byte; what had come and was not read when the port is closed is counted there.
    """

    def __init__(self, port: Port, keep: KeepWire, now: Callable[[], float] = time.monotonic) -> None:
        self._port = port
        self._keep = keep
        self._now = now
        self._is_there = True

    @classmethod
    def opened(cls, open_port: Callable[[], Port], keep: KeepWire, now: Callable[[], float] = time.monotonic) -> Self:
        """Open a port and note that, or why it could not be opened, which is raised as it came."""
        try:
            port = open_port()
        except LinkError as error:
            keep(Passed(now(), "failed", text=str(error)))
            raise
        keep(Passed(now(), "opened", text=port.url))
        return cls(port, keep, now)

    @property
    def url(self) -> str:
        return self._port.url

    def fileno(self) -> int | None:
        return self._port.fileno()

    def write(self, data: bytes) -> None:
        self._keep(Passed(self._now(), "sent", data))
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
            self._keep(Passed(self._now(), "heard", data))
        return data

    def _end(self, how: Literal["lost", "closed"], text: str = "") -> None:
        """Note the end of the link, once: a port that was lost is closed as well."""
        if self._is_there:
            self._is_there = False
            self._keep(Passed(self._now(), how, text=text))


# -- session history ----------------------------------------------------------------------------------------------------------

T = TypeVar("T")

NAMES: dict[type[Request], WishName] = {Ask: "ask", Listen: "listen", Wait: "wait", Reopen: "reopen", Gather: "gather"}
THROWN: dict[type[Exception], ToldName] = {RunEnded: "stopped", NotStarted: "not_started", LeftOut: "left_out"}
ENDS: dict[ToldName, type[RunEnded]] = {"stopped": RunEnded, "not_started": NotStarted, "left_out": LeftOut}
ROUNDING_S = 1e-6  # a moment may come so much before its time, by the way in which it was reckoned

Keep = Callable[[Told], object]


def keeping(steps: Steps[T], keep: Keep, now: Callable[[], float]) -> Steps[T]:
    """`steps`, with `keep` called for everything that they are told, before they hear it."""
    last = 0.0
    try:
        wish = next(steps)
        while True:
            name = NAMES[type(wish)]
            try:
                heard = yield wish
            except (LinkError, RunEnded) as error:
                keep(Told(now(), THROWN.get(type(error), "broke"), name, text=str(error)))
                wish = steps.throw(error)
            else:
                last = heard.now
                keep(Told(last, "told", name, len(heard.data), heard.sent, late_s=heard.late_s))
                wish = steps.send(heard)
    except StopIteration as end:
        keep(Told(max(last, now()), "done", "wait"))
        result: T = end.value
        return result


class Step(NamedTuple):
    """One thing that a session was told: with the question that it had sent, if any, and the bytes it was given.

    `place` is the number of the first row that belongs to it.
    """

    place: int
    told: Told
    asked: bytes
    data: bytes

    def __str__(self) -> str:
        return "the end" if self.told.what == "done" else f"{self.told.wish} {self.asked!r}" if self.asked else self.told.wish

    def answers(self, wish: Request) -> bool:
        """Whether this can be what came of `wish`."""
        told = self.told
        if told.what == "done" or NAMES[type(wish)] != told.wish:
            return False
        if isinstance(wish, Ask) and self.asked != wish.data and (self.asked or told.what == "told"):
            return False
        return told.what != "told" or bool(self.data) or told.at_s >= self._deadline(wish) - ROUNDING_S

    def _deadline(self, wish: Request) -> float:
        """The moment before which nothing is told without bytes."""
        if isinstance(wish, Ask):
            return self.told.sent_s + wish.patience_s
        return wish.until if isinstance(wish, Listen | Wait) else 0.0


def steps_of(rows: Iterable[Row]) -> Iterator[Step]:
    """The rows of a tape as what its session was told, one after the other."""
    first, asked, came = 0, b"", b""
    for place, row in enumerate(rows):
        if isinstance(row, Told):
            yield Step(first, row, asked, came[: row.size])
            first, asked, came = place + 1, b"", came[row.size :]
        elif row.what == "sent":
            asked = row.data
        elif row.what == "heard":
            came += row.data
        elif row.what == "opened":
            came = b""  # what came over the last port and was not told is gone with it


class Astray(NamedTuple):
    """Where a session left what was recorded: what it wished, and the step that does not answer it (None: none is left)."""

    at_s: float
    wish: Request
    step: Step | None

    def __str__(self) -> str:
        wished = f"{NAMES[type(self.wish)]} {self.wish.data!r}" if isinstance(self.wish, Ask) else NAMES[type(self.wish)]
        return f"it would {wished}; recorded is {'nothing more' if self.step is None else self.step}"

    @property
    def is_cut_off(self) -> bool:
        """Whether the recording ended before its session did."""
        return self.step is None


Left = Callable[[Astray], tuple[float, str]]
"""Is told that a session left the tape; gives the moment at which it is to be ended all the same, and why."""


def reliving(steps: Steps[T], tape: Iterable[Step], left: Left) -> Steps[T | None]:
    """`steps`, told what `tape` says. The driver only hears of waits, so that its clock goes along.

    A tape from before sessions waited for each other has no word of that: there nobody is waited for.

    Where the session wishes what the tape does not answer, `left` is told, and the driver has to fulfil its wishes from
    there on. Where the tape ends before its session did, the session is left as its recorder left it: it gives None.
    """
    try:
        wish, now = next(steps), 0.0
        for step in tape:
            while isinstance(wish, Gather) and step.told.wish != "gather":
                wish = steps.send(Heard(now, b"", 0.0))
            if not step.answers(wish):
                return (yield from _on_its_own(steps, wish, *left(Astray(now, wish, step))))
            now = step.told.at_s
            yield Wait(now)
            wish = _tell(steps, step)
    except StopIteration as end:
        result: T = end.value
        return result
    left(Astray(now, wish, None))
    return None


def _tell(steps: Steps[T], step: Step) -> Request:
    told = step.told
    if told.what == "broke":
        return steps.throw(LinkError(told.text))
    if told.what in ENDS:
        return steps.throw(ENDS[told.what](told.text))
    return steps.send(Heard(told.at_s, step.data, told.sent_s, told.late_s))


def _on_its_own(steps: Steps[T], wish: Request, end_s: float, why: str) -> Steps[T]:
    """Have the driver fulfil what is wished from `wish` on, over a port that is open as far as the session knows."""
    if not isinstance(wish, Reopen):
        with suppress(LinkError):  # the session hears of that at its next question
            yield Reopen()
    try:
        while True:
            try:
                # the others are on tapes of their own, and wait for nobody
                heard = yield Wait(0.0) if isinstance(wish, Gather) else wish
            except (LinkError, RunEnded) as error:
                wish = steps.throw(error)
            else:
                is_over, end_s = heard.now >= end_s, inf if heard.now >= end_s else end_s
                wish = steps.throw(RunEnded(why)) if is_over else steps.send(heard)
    except StopIteration as end:
        result: T = end.value
        return result
