"""What passed over one wire, and what its session was told of it: the rows of a wire record, in the order they came in.

A session knows nothing but what it is told (`core.io_requests`). Told the same again, byte for byte and moment for moment, it
does the same again; so these rows are enough to live through a run once more. `transport` notes what passed, `drive`
what was told, `record` keeps both, and a replay is made of them.

All moments are monotonic seconds of the recorder.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

WishName = Literal["ask", "listen", "wait", "reopen", "gather"]
PassedName = Literal["sent", "heard", "opened", "failed", "lost", "closed"]
ToldName = Literal["told", "broke", "stopped", "not_started", "left_out", "done"]


class Passed(NamedTuple):
    """Bytes that went one way at once, or a change of the link.

    ``sent``: `data` is about to be handed over. ``heard``: `data` has come. ``opened``, ``failed`` (it could not be
    opened), ``lost`` (it broke), ``closed``: `text` says more.
    """

    at_s: float
    what: PassedName
    data: bytes = b""
    text: str = ""


class Told(NamedTuple):
    """What the session was told, and the wish that this answered.

    ``told``: the moment and the next `size` bytes that had come; `sent_s` is when its question left, where it had asked
    one; `late_s` by how much the recorder itself was seen to be late. ``broke``: the link, as `text` says. ``stopped``: the run
    ends, as `text` says. ``not_started``: it does not start because of the stations that `text` names; ``left_out``: without
    this one, as `text` says. ``done``: nothing, the session had ended.
    """

    at_s: float
    what: ToldName
    wish: WishName
    size: int = 0
    sent_s: float = 0.0
    text: str = ""
    late_s: float = 0.0


Row = Passed | Told
