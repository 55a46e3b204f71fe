"""Rows of a serial capture: the traffic on one link and the results its session received.

A session depends only on the results of its requests (`core.io_requests`), so these rows reproduce
a run exactly. `transport` makes them, `record` stores them. Times are monotonic seconds of the
recorder.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

RequestName = Literal["ask", "listen", "wait", "reopen", "gather"]
LinkRowKind = Literal["sent", "heard", "opened", "failed", "lost", "closed"]
ResultKind = Literal["told", "broke", "stopped", "not_started", "left_out", "done"]


class LinkRow(NamedTuple):
    """Bytes in one direction, or a change of the link's state.

    ``sent``: `data` is about to be written. ``heard``: `data` was read. ``opened``, ``failed`` (to
    open), ``lost``, ``closed``: `text` has details.
    """

    at_s: float
    what: LinkRowKind
    data: bytes = b""
    text: str = ""


class ResultRow(NamedTuple):
    """Result of one request of the session; `text` has details.

    ``told``: the next `size` bytes received; `sent_s` is when the data of an ``ask`` left, `late_s`
    how late the recorder was. ``broke``: link lost. ``stopped``: the run ends. ``not_started``: the
    run does not start because of the stations in `text`. ``left_out``: it starts without this
    station. ``done``: the session has ended.
    """

    at_s: float
    what: ResultKind
    request: RequestName
    size: int = 0
    sent_s: float = 0.0
    text: str = ""
    late_s: float = 0.0


CaptureRow = LinkRow | ResultRow
