"""How many bytes come over a link, held against those of the answers that are due: far more of them is a flood.

The rules:

1. A link is flooded when over one second more than `MOST_TIMES` the bytes of the answers that are due come over it, however fast
   it is. Where little or nothing is due, `LEAST_DUE` bytes a second are reckoned. A second begins with the first bytes that are
   told behind the last one; where nothing is told for longer, as while a session waits, the same holds for all of that time.
   Answers that are late stay due: a station or a server that was stuck may give them all at once, each of them once.
2. Among so many bytes any answer may be a copy of an old one. So before the second is over already, from `SUSPECT` bytes on,
   no answer is believed while more than `MOST_TIMES` of what is due has come.

3. A link that was flooded is quiet again once `QUIET_S` behind its opening have brought less than a flood does (`expect_quiet`).

It knows bytes and moments only, so a run that is lived through again comes to the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from jbclog.core.errors import LinkFlooded
from jbclog.core.io_requests import Steps, Wait

if TYPE_CHECKING:
    from jbclog.protocol.client.interface import Client

SECOND: Final = 1.0
MOST_TIMES: Final = 10
LEAST_DUE: Final = 16  # bytes a second: one usual answer
SUSPECT: Final = 512  # bytes: more than noise brings at once
QUIET_S: Final = 0.25


class Flow:
    """The bytes of one link. `is_flooded`: the last second that was over brought a flood."""

    __slots__ = ("_begun", "_came", "_due", "_late", "found", "is_flooded")

    def __init__(self) -> None:
        self._begun: float | None = None
        self._came = self._due = self._late = 0
        self.is_flooded = False
        self.found: LinkFlooded | None = None  # a flood that nobody has been told of

    def came(self, now: float, size: int, due: int = 0) -> bool:
        """`size` bytes were told at `now` (monotonic seconds), behind a question with an answer of `due` bytes.

        Whether no answer among them is to be believed.
        """
        self._came += size
        self._due += due
        if self._begun is None:
            self._begun = now
        elif now - self._begun >= SECOND:
            self._judge(now - self._begun)
            self._begin(now)
        return self._came > SUSPECT and self.is_suspect

    @property
    def is_suspect(self) -> bool:
        """Whether so much has come since the second began that no answer is to be believed."""
        return self._came > max(SUSPECT, MOST_TIMES * self._due + self._late) or self.found is not None

    def taken(self) -> LinkFlooded:
        """The flood that was found, for whoever raises it; what comes from here on is counted anew."""
        found, self.found = self.found, None
        assert found is not None
        self._begun = None
        self._came = self._due = self._late = 0
        return found

    def calm(self) -> None:
        """The link has been opened anew, and is quiet: what came before counts no more."""
        self.is_flooded, self.found, self._begun = False, None, None
        self._came = self._due = self._late = 0

    def _judge(self, seconds: float) -> None:
        limit = MOST_TIMES * max(self._due, round(LEAST_DUE * seconds)) + self._late
        self.is_flooded = self._came > limit
        if self.is_flooded:
            self.found = LinkFlooded(self._came, self._due, seconds, limit)

    def _begin(self, now: float) -> None:
        self._begun, self._late = now, max(0, self._late + self._due - self._came)
        self._came = self._due = 0


def expect_quiet(client: Client) -> Steps[None]:
    """Ask nothing for a while on a link that was flooded and is open again. Raises `LinkFlooded` where it still is."""
    began = client.now
    heard = yield Wait(began + QUIET_S)
    client.unasked(heard)
    seconds = max(heard.now - began, QUIET_S)
    limit = round(MOST_TIMES * LEAST_DUE * seconds)
    client.flow.calm()
    if len(heard.data) > limit:
        client.flow.is_flooded = True
        raise LinkFlooded(len(heard.data), 0, seconds, limit)
