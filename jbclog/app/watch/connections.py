"""Limits of the page's connections: how many, and how long an idle one stays.

uvicorn itself waits without a limit for a request that does not come, and for a client that reads
nothing: a client that opens a thousand connections would hold them, with all data queued for it.
"""

from __future__ import annotations

import asyncio
from operator import attrgetter
from typing import Final

from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

MOST_CONNECTIONS: Final = 250
AT_ONCE: Final = 100  # accepted before connections are counted
WAITS_S: Final = 20.0  # for a whole request, and for a client to read what is written
LOOK_S: Final = 5.0


class Connection(H11Protocol):
    """A connection that is closed when nothing moves on it.

    If there are too many, the one that has waited for its client for longest is closed, so that a
    prompt client gets an answer.
    """

    _timer: asyncio.TimerHandle | None = None
    _seen: RequestResponseCycle | None = None
    moved_s = 0.0
    is_ended = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        super().connection_made(transport)
        self._moves()
        self._timer = self.loop.call_later(LOOK_S, self._look)
        self._end_longest_waiting()

    def connection_lost(self, exc: Exception | None) -> None:
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        self._moves()
        super().pause_writing()

    def resume_writing(self) -> None:
        self._moves()
        super().resume_writing()

    @property
    def is_waiting(self) -> bool:
        """Whether the client has to act: send a request, or read what is written."""
        return self.cycle is None or self.cycle.response_complete or self.flow.write_paused

    def _moves(self) -> None:
        self.moved_s = self.loop.time()

    def _end_longest_waiting(self) -> None:
        held = [one for one in self.connections if isinstance(one, Connection) and not one.is_ended]
        if len(held) > MOST_CONNECTIONS:
            waiting = [one for one in held if one.is_waiting]  # this one at least
            min(waiting, key=attrgetter("moved_s")).end()

    def end(self) -> None:
        """Abort the connection: a graceful close would wait for the client to read the rest."""
        self.is_ended = True
        self.transport.abort()

    def _look(self) -> None:
        """Abort the connection if it waited too long for its client."""
        if self.cycle is not self._seen or not self.is_waiting:
            self._seen = self.cycle
            self._moves()
        elif self.loop.time() - self.moved_s > WAITS_S:
            self.end()
            return
        self._timer = self.loop.call_later(LOOK_S, self._look)
