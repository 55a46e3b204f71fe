"""The rows of a serial capture: what passed over one link, and the results that its session
received.

A session depends on nothing but the results of its requests (`core.io_requests`), so these rows are
enough to reproduce a run exactly. `transport` notes them, `record` stores them. All moments are
monotonic seconds of the recorder.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

RequestName = Literal["ask", "listen", "wait", "reopen", "gather"]
LinkRowKind = Literal["sent", "heard", "opened", "failed", "lost", "closed"]
ResultKind = Literal["told", "broke", "stopped", "not_started", "left_out", "done"]


class LinkRow(NamedTuple):
    """Bytes in one direction, or a change of the link.

    ``sent``: `data` is about to be written. ``heard``: `data` was read. ``opened``, ``failed``
    (opening), ``lost``, ``closed``: `text` has details.
    """

    at_s: float
    what: LinkRowKind
    data: bytes = b""
    text: str = ""


class ResultRow(NamedTuple):
    """The result of one of the session's requests.

    ``told``: the next `size` bytes of those heard; `sent_s` is when the data of an ``ask`` left,
    `late_s` by how much the recorder was late. ``broke``: link lost. ``stopped``: the run ends.
    ``not_started``: it does not start because of the stations in `text`; ``left_out``: it starts
    without this one. ``done``: the session has ended. `text` has details.
    """

    at_s: float
    what: ResultKind
    request: RequestName
    size: int = 0
    sent_s: float = 0.0
    text: str = ""
    late_s: float = 0.0


CaptureRow = LinkRow | ResultRow
