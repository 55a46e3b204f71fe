"""A recorded station, replayed from its capture without I/O: each request gets its recorded answer.

Answers come as recorded, with their delay: whole, in pieces, corrupt, late, twice, or not at all.
If the link was lost after a request, it is lost again, for the same time, and on a sampling grid
even for a client that skipped this request. The rules:

1. Each request has its own queue of answers, and each repetition takes the next: so a client with a
   slightly different order of requests gets the same values.
2. No answer from after a recorded write is given before that write comes, and none from before it
   afterwards (the stretches of `exchanges`). A write that comes sets the client's place, whatever
   it left out.
3. The clocks of client and capture run alike. Time that a host loses in passing bytes on is
   subtracted from the next answer, except from one that came too late, which must not
   come in time now. An answer well before the client's time is skipped if a later
   one is nearer, which `left_out` counts: a client that missed a tick gets the values of its
   present tick.
4. A request and its second and third look are one group (`retry_groups`), replayed in order or
   skipped as a whole: an answer that the recording contradicts right after is never given without
   the contradiction.
5. A request repeated more often than recorded gets the accepted answer at this position of the
   capture, which `repeated` counts. Alarm flags, which a station holds until they are read, are
   neither given twice nor skipped. After the end of the capture there is silence, as for a request
   that was never recorded, which `strange` counts: nothing is made up.
"""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from math import inf
from statistics import median_low

from jbclog.core.capture_rows import CaptureRow
from jbclog.sim.recorded_exchanges import (
    LOOK_S,
    Contents,
    Exchange,
    RecordedGrid,
    RetryGroup,
    exchanges,
    has_flags,
    is_write,
    retry_groups,
)
from jbclog.sim.virtual import Reply

LATELY = 16  # exchanges for comparing the two clocks
# share of the time between two answers to one request within which the nearer one counts, whatever
# the order
NEAR = 0.25
MADE_GOOD_S = 0.02  # maximum difference of a request's time that its answer compensates
LEFT = 0.5  # minimum share of a recorded delay
# of a loss that the client missed: time until it begins, and shortest duration
SOON_S, SHORTEST_S = 1e-3, 0.05
# after the last recorded request; in this time the last answers still count for a client that runs
# a little longer
OVER_S = 5.0
AGAIN = 3  # repetitions of the last answer if the capture may be over


class ReplayedStation:
    """A station that replays `rows`, read when needed.

    Recorded delays include the passing of bytes between programs; if that happens again, on a port,
    each answer begins `early_s` before its time. `ticks` is the sampling grid, if known.

    `strange` counts requests that were never recorded, `repeated` those that came more often than
    recorded, `left_out` recorded ones that the client skipped.
    """

    def __init__(
        self,
        name: str,
        rows: Callable[[], Iterable[CaptureRow]],
        early_s: float = 0.0,
        ticks: RecordedGrid | None = None,
    ) -> None:
        self.name = name
        self.strange = 0
        self.repeated: Counter[bytes] = Counter()
        self.left_out = 0
        self._early_s = early_s
        self._ticks = ticks
        first_s = ticks.first_s if ticks else None
        self._contents = Contents.of(exchanges(rows(), first_s))
        self._coming = retry_groups(exchanges(rows(), first_s), ticks, self._contents.sampled)
        self._ahead = next(self._coming, None)
        self._rows: defaultdict[bytes, deque[RetryGroup]] = defaultdict(deque)
        # the rest of the present group
        self._left: defaultdict[bytes, deque[Exchange]] = defaultdict(deque)
        self._last: dict[bytes, Exchange] = {}
        self._accepted: dict[bytes, Exchange] = {}
        self._asked, self._asked_at = b"", -inf  # the previous request
        self._starts = {
            question[:length]
            for question in self._contents.known
            for length in range(1, len(question))
        }
        self._lengths = sorted({len(question) for question in self._contents.known}, reverse=True)
        self._heard = b""
        self._outages: list[tuple[float, float]] = []
        self._lost_after: set[float] = set()  # times of the exchanges after which the link was lost
        self._stretch = 0
        self._again: Counter[bytes] = Counter()  # as `repeated`, in this stretch
        # clock of the capture minus the client's, at the last exchanges
        self._offsets: deque[float] = deque(maxlen=LATELY)
        # the same, at requests that began a tick on time
        self._tick_offsets: deque[float] = deque(maxlen=LATELY)
        self._is_in_time = False  # the offsets determine the position in the capture

    def receive(self, data: bytes, now: float) -> list[Reply]:
        """Return the answers to `data` written at `now`: bytes, each with its time of arrival."""
        if self.is_unplugged(now):
            self._heard = b""
            return []
        replies = [
            reply for question in self._questions(data) for reply in self._replies(question, now)
        ]
        return [reply for reply in replies if not self.is_unplugged(reply.at)]

    def is_unplugged(self, now: float) -> bool:
        return any(begin <= now < end for begin, end in self._outages)

    def next_plugging(self, now: float) -> float | None:
        """Return when `is_unplugged` changes next, as far as known."""
        return min(
            (moment for outage in self._outages for moment in outage if now < moment < inf),
            default=None,
        )

    def _questions(self, data: bytes) -> Iterator[bytes]:
        """Yield the known requests received; an incomplete one is kept until the rest arrives."""
        self._heard += data
        dropped = False
        while self._heard and self._heard not in self._starts:
            length = next(
                (
                    length
                    for length in self._lengths
                    if self._heard[:length] in self._contents.known
                ),
                0,
            )
            if length:
                yield self._heard[:length]
            dropped |= not length
            self._heard = self._heard[length or 1 :]
        self.strange += dropped

    def _replies(self, question: bytes, now: float) -> list[Reply]:
        self._enter(question)
        if self._loses_link(now):
            return []
        one = self._next(question, now)
        if one is None:
            one, behind_s = self._repeated_answer(question, now), 0.0
        else:
            behind_s = self._behind_s(one, now)
            self._note(one, now)
        self._asked, self._asked_at = question, now
        return [
            Reply(now + (delay_s if one.was_late else self._delay_s(delay_s, behind_s)), data)
            for delay_s, data in one.replies
        ]

    def _behind_s(self, one: Exchange, now: float) -> float:
        """Return how much later than recorded the client asked, if passing bytes explains it."""
        behind_s = self._time(now) - one.at_s if self._offsets else 0.0
        return behind_s if abs(behind_s) <= MADE_GOOD_S else 0.0

    def _delay_s(self, delay_s: float, behind_s: float) -> float:
        """Return the rest of a recorded delay, so that the client has the answer in time."""
        return max(max(delay_s - behind_s, LEFT * delay_s) - self._early_s, 0.0)

    def _time(self, now: float) -> float:
        """Convert the client's time to the clock of the capture."""
        return now + median_low(self._tick_offsets or self._offsets)

    def _enter(self, question: bytes) -> None:
        """Enter the stretch that begins with this request, unless the present one still has it."""
        found = self._written(question) if is_write(question) else self._sampled(question)
        if found is not None:
            self._begin(found)

    def _written(self, question: bytes) -> int | None:
        """Return the next stretch that begins with this write; None if it belongs to the present
        one, or to none.
        """
        firsts = self._contents.firsts
        if firsts[self._stretch] == question and self._is_waited_for(question):
            return None
        return next(
            (
                number
                for number in range(self._stretch + 1, len(firsts))
                if firsts[number] == question
            ),
            None,
        )

    def _sampled(self, question: bytes) -> int | None:
        """Return the next stretch, if it begins with the first tick and the client has reached
        it.
        """
        firsts, number = self._contents.firsts, self._stretch + 1
        if number >= len(firsts) or is_write(firsts[number]) or self._is_waited_for(question):
            return None
        return number if firsts[number] == question or self._again[question] >= AGAIN else None

    def _begin(self, stretch: int) -> None:
        """Enter a stretch, skipping everything before it."""
        self._stretch = stretch
        self._again.clear()
        for row in self._rows.values():
            self.left_out += sum(len(group.all) for group in row)
            row.clear()
        for left in self._left.values():
            self.left_out += len(left)
            left.clear()
        while self._ahead is not None and self._ahead.stretch < stretch:
            self.left_out += len(self._ahead.all)
            self._ahead = next(self._coming, None)
        self._offsets.clear()
        self._tick_offsets.clear()
        self._is_in_time = False  # off the grid times depend on the host: only the order counts

    def _is_waited_for(self, question: bytes) -> bool:
        """Return True if the present stretch still has this request."""
        return bool(self._left[question]) or self._reach(question, 1)

    def _reach(self, question: bytes, count: int, until_s: float = inf) -> bool:
        """Read ahead until `count` groups of that request wait, or to a time, within this
        stretch.
        """
        row = self._rows[question]
        while len(row) < count:
            one = self._ahead
            if one is None or one.stretch > self._stretch or one.at_s > until_s:
                return False
            self._rows[one.question].append(one)
            self._ahead = next(self._coming, None)
        return True

    def _next(self, question: bytes, now: float) -> Exchange | None:
        """Return the exchange due for that request; None: not yet, or never in this stretch."""
        left = self._left[question]
        if left and self._is_at(question, now):
            return left.popleft()
        row, is_in_time = self._rows[question], self._is_in_time and self._offsets
        if not (self._reach_due(question, now) if is_in_time else self._reach(question, 1)):
            return None
        self._skip_exchanges(left, now)
        if is_in_time:
            self._skip_groups(row, question, now)
        return self._begin_group(row.popleft())

    def _is_at(self, question: bytes, now: float) -> bool:
        """Return True if the client is still at the present group."""
        if not (self._is_in_time and self._offsets) or self._is_next_look(question, now):
            return True
        time_s, left_s, row = self._time(now), self._left[question][0].at_s, self._rows[question]
        far_s = (time_s - NEAR * left_s) / (1 - NEAR)
        return not (
            self._reach(question, 1, far_s) and self._is_nearer(time_s, left_s, row[0].at_s)
        )

    def _is_next_look(self, question: bytes, now: float) -> bool:
        """Return True if the client repeats the request right after its answer."""
        last = self._last.get(question)
        answered_s = last.replies[-1][0] if last is not None and last.replies else 0.0
        return question == self._asked and now - self._asked_at - answered_s < LOOK_S

    def _reach_due(self, question: bytes, now: float) -> bool:
        """Return True if there is a next group, and the client has reached it."""
        last, row = self._last.get(question), self._rows[question]
        if last is None or last.stretch != self._stretch:
            return self._reach(question, 1)
        gone_s = self._time(now) - last.at_s
        if question == self._asked:  # the client reads the last answer again
            gone_s = min(gone_s, now - self._asked_at)
        far_s = last.at_s + max(gone_s, 0.0) / NEAR
        return self._reach(question, 1, far_s) and row[0].at_s <= far_s

    def _skip_groups(self, row: deque[RetryGroup], question: bytes, now: float) -> None:
        """Skip the groups before the client's time."""
        time_s = self._time(now)
        while self._reach(question, 2, 2 * time_s - row[0].at_s) and self._is_nearer(
            time_s, row[0].at_s, row[1].at_s
        ):
            if row[0].has_flags:
                return  # flags stay until they are read
            self._skip_exchanges(deque(row.popleft().all), now)

    def _skip_exchanges(self, left: deque[Exchange], now: float) -> None:
        while left:
            self.left_out += 1
            self._lose(left.popleft(), now)

    def _begin_group(self, group: RetryGroup) -> Exchange:
        """Return the first of a group; the others wait."""
        question, (first, *others) = group.question, group.all
        self._left[question].extend(others)
        believed = group.believed(self._accepted.get(question))
        if believed is not None:
            self._accepted[question] = believed
        return first

    @staticmethod
    def _is_nearer(time_s: float, first_s: float, second_s: float) -> bool:
        return time_s > second_s - NEAR * (second_s - first_s)

    def _repeated_answer(self, question: bytes, now: float) -> Exchange:
        """Return the answer at this position of the capture."""
        self.repeated[question] += 1
        self._again[question] += 1
        is_over = self._is_in_last_stretch() and (
            not self._is_in_time
            or not self._offsets
            or self._time(now) > self._contents.last_s + OVER_S
        )
        silence = Exchange(question, 0.0)
        return (
            silence
            if is_over and self._again[question] > AGAIN
            else self._accepted_answer(question, silence)
        )

    def _is_in_last_stretch(self) -> bool:
        """Return True if no recorded write or first tick is still to come: before it the capture
        cannot be over, however often a client with a busy host asks again.
        """
        return self._stretch + 1 >= len(self._contents.firsts)

    def _accepted_answer(self, question: bytes, silence: Exchange) -> Exchange:
        """Return the accepted answer; for flags that reading clears, the next one if cleared."""
        one = self._accepted.get(question, silence)
        if not has_flags(one) or not self._reach(question, 1):
            return one
        after = self._rows[question][0]
        return one if after.has_flags else after.all[-1]

    def _note(self, one: Exchange, now: float) -> None:
        """Register the exchange: it sets the place in the capture, and the state of the link."""
        self._last[one.question] = one
        self._set_clock(one, one.at_s - now)
        self._lose(one, now)

    def _set_clock(self, one: Exchange, offset: float) -> None:
        """Synchronize the clocks; on a grid, by requests that began ticks in time."""
        self._offsets.append(offset)
        ticks = self._ticks
        if ticks is None:
            self._is_in_time |= len(self._offsets) == LATELY
        elif one.question == self._contents.sampled and ticks.is_on_time(one.at_s):
            self._tick_offsets.append(offset)
            self._is_in_time = True

    def _lose(self, one: Exchange, now: float) -> None:
        """Lose the link if it was lost after this exchange, and has not been lost since."""
        if one.lost_s is not None and one.at_s not in self._lost_after:
            self._lost_after.add(one.at_s)
            self._outages.append((now + one.lost_s, now + one.back_s))

    def _loses_link(self, now: float) -> bool:
        """Lose the link if the client's time has passed a loss whose request a busy client left
        out; return whether it was.
        """
        if not self._tick_offsets:
            return False
        time_s = self._time(now) - MADE_GOOD_S
        missed = [one for one in self._contents.losses if self._is_missed(one, time_s)]
        for one in missed:
            self._lost_after.add(one.at_s)
            back_s = max(one.at_s + one.back_s - time_s, SHORTEST_S)
            self._outages.append((now + SOON_S, now + back_s))
        return bool(missed)

    def _is_missed(self, one: Exchange, time_s: float) -> bool:
        """Return True if the link should have been lost after this exchange at `time_s`."""
        return (
            one.lost_s is not None
            and one.stretch == self._stretch
            and one.at_s not in self._lost_after
            and one.at_s + one.lost_s < time_s
        )
