"""A recorded station, played from its tape without any I/O: to a question that was asked then, what was answered then.

What came is given as it came, with its delay: whole, in pieces, corrupt, late, twice, or not at all. Where the link was
lost after a question, it is lost again, for as long. The rules of what is next:

1. Each question has its own row of answers in the order in which they were recorded, and each asking takes the next: so
   a client that asks in a slightly other order gets the same values all the same.
2. Answers far behind the place on the tape that the client has otherwise come to are left out, while later ones are there.
   So is everything before a question that was asked only once, and far ahead of that place: an order at the end.
3. Asked somewhat more often than then, a question gets its last answer again; then there is silence. A question that was
   never asked is met with silence at once: nothing is made up.
"""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from math import inf
from statistics import median_low

from jbclog.sim.virtual import Reply
from jbclog.tape import Passed, Row

LATELY = 16  # exchanges whose middle one is the place on the tape: a single one may lie far ahead
FAR = 32  # exchanges from that: half a second of a full wire
AGAIN = 3  # times that a question gets its last answer once more


@dataclass(slots=True)
class Exchange:
    """One question as it was recorded, and what came of it until the next; seconds count from the question.

    `place` is its number on the tape.
    """

    place: int
    question: bytes
    replies: list[tuple[float, bytes]] = field(default_factory=list)
    lost_s: float | None = None  # when the link was lost after it
    back_s: float = inf

    def lost(self, after_s: float) -> None:
        """The link was lost, or was still away."""
        self.lost_s, self.back_s = after_s if self.lost_s is None else self.lost_s, inf


def exchanges(rows: Iterable[Row]) -> Iterator[Exchange]:
    """The exchanges on a tape, in order. What came before the first question belongs to none."""
    one, asked_at, down_since = None, 0.0, 0.0
    for row in rows:
        if not isinstance(row, Passed):
            continue
        if row.what == "sent":
            if one is not None:
                yield one
            one, asked_at = Exchange(0 if one is None else one.place + 1, row.data), row.at_s
        elif one is None:
            continue
        elif row.what == "heard":
            one.replies.append((row.at_s - asked_at, row.data))
        elif row.what in ("lost", "failed"):
            one.lost(row.at_s - asked_at)
            down_since = row.at_s
        elif row.what == "opened" and one.lost_s is not None and one.back_s == inf:
            one.back_s = (down_since + row.at_s) / 2 - asked_at  # it came back between the last try that failed and this one
    if one is not None:
        yield one


class TapeStation:
    """A station that plays `rows`. They are read when they are needed; `speed` divides all delays.

    Recorded delays hold what it took to hand bytes over; who serves it on a port, where that is taken again, has each
    answer begin `early_s` before its time.

    `strange` counts what was heard and never recorded, `repeated` the questions that came more often than they were recorded.
    """

    def __init__(self, name: str, rows: Callable[[], Iterable[Row]], speed: float = 1.0, early_s: float = 0.0) -> None:
        self.name = name
        self.strange = 0
        self.repeated: Counter[bytes] = Counter()
        self._speed = speed
        self._early_s = early_s
        self._coming = exchanges(rows())
        self._rows: defaultdict[bytes, deque[Exchange]] = defaultdict(deque)
        self._last: dict[bytes, Exchange] = {}
        self._known = Counter(row.data for row in rows() if isinstance(row, Passed) and row.what == "sent")
        self._starts = {question[:length] for question in self._known for length in range(1, len(question))}
        self._lengths = sorted({len(question) for question in self._known}, reverse=True)
        self._heard = b""
        self._outages: list[tuple[float, float]] = []
        self._lately: deque[int] = deque(maxlen=LATELY)
        self._floor = 0  # what lies before this place is left out

    def receive(self, data: bytes, now: float) -> list[Reply]:
        """What comes back to `data` written at `now`: bytes, each with the moment at which they are there."""
        if self.hung_up(now):
            self._heard = b""
            return []
        replies = [reply for question in self._questions(data) for reply in self._replies(question, now)]
        return [reply for reply in replies if not self.hung_up(reply.at)]

    def hung_up(self, now: float) -> bool:
        """Whether the link is lost."""
        return any(begin <= now < end for begin, end in self._outages)

    def next_plugging(self, now: float) -> float | None:
        """When `hung_up` changes next, as far as is known."""
        return min((moment for outage in self._outages for moment in outage if now < moment < inf), default=None)

    def _questions(self, data: bytes) -> Iterator[bytes]:
        """The known questions in what has been heard; a piece of one is kept until the rest of it comes."""
        self._heard += data
        dropped = False
        while self._heard and self._heard not in self._starts:
            length = next((length for length in self._lengths if self._heard[:length] in self._known), 0)
            if length:
                yield self._heard[:length]
            dropped |= not length
            self._heard = self._heard[length or 1 :]
        self.strange += dropped

    def _replies(self, question: bytes, now: float) -> list[Reply]:
        one = self._next(question, now)
        if one is None:
            self.repeated[question] += 1
            one = self._last[question] if self.repeated[question] <= AGAIN else Exchange(0, question)
        else:
            self._go_on(one, now)
        return [Reply(now + max(delay_s / self._speed - self._early_s, 0.0), data) for delay_s, data in one.replies]

    def _next(self, question: bytes, now: float) -> Exchange | None:
        """The next exchange with that question; earlier ones are left out where they lie behind."""
        row = self._rows[question]
        while self._reach(question, 1) and row[0].place < self._floor and self._reach(question, 2):
            self._lose(row.popleft(), now)
        return row.popleft() if row else None

    def _reach(self, question: bytes, count: int) -> bool:
        """Read on until so many exchanges with that question wait; those before them wait for theirs."""
        row = self._rows[question]
        while len(row) < count:
            one = next(self._coming, None)
            if one is None:
                return False
            self._rows[one.question].append(one)
        return True

    def _go_on(self, one: Exchange, now: float) -> None:
        """This exchange happens: the place on the tape, and the link, are what they were then."""
        self._last[one.question] = one
        place = median_low(self._lately) if self._lately else one.place
        if self._known[one.question] == 1 and one.place > place + FAR:
            self._floor = one.place
        self._lately.append(one.place)
        if len(self._lately) == LATELY:
            self._floor = max(self._floor, median_low(self._lately) - FAR)
        self._lose(one, now)

    def _lose(self, one: Exchange, now: float) -> None:
        """Lose the link where it was lost after this exchange."""
        if one.lost_s is not None:
            self._outages.append((now + one.lost_s / self._speed, now + one.back_s / self._speed))
