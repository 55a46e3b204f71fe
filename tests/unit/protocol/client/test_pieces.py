"""Answers in pieces: split bytes give what whole ones do, and an answer that was accepted before is
read as any other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from support.clients.talk import framed
from support.product import (
    FAMILIES,
    Ask,
    FloodDetector,
    IoResult,
    LineFormat,
    LinkFlooded,
    Listen,
    Request,
    Station,
    StationError,
    Steps,
    Value,
    Wait,
    pull,
    send,
)

TIP, POWER = (FAMILIES["dde"].commands[name] for name in ("tip_temperature", "power"))
USUAL, OTHER = framed("ATT100183"), framed("APP100017")

Chunk = tuple[float, bytes]  # seconds after the last one


def tip(station: Station) -> Steps[Value]:
    return station.ask(station.question(TIP, 1))


class Exchange:
    """A station that was read twice, said `unasked` bytes, and after `wait_s` was read once in
    `chunks`, and once more.
    """

    def __init__(
        self,
        chunks: Sequence[Chunk],
        unasked: int = 0,
        wait_s: float = 0.0,
        *,
        is_first: bool = False,
    ) -> None:
        self.station, self.now, self.sent = Station(LineFormat(), 1), 100.0, 0.0
        self.requests: list[Request] = []
        self.outcomes: list[object] = []
        self._do(tip, [(0.001, USUAL)])
        self._do(tip, [(0.001, USUAL)])
        self.station.unasked(IoResult(self.now, b"x" * unasked, self.sent))
        self.now += wait_s
        if is_first:  # no answer was accepted before
            self.station.question(TIP, 1).answers = {}
        self._do(tip, list(chunks))
        self._do(lambda station: station.ask(station.question(POWER, 1)), [(0.001, OTHER)])

    def _do(self, read: Callable[[Station], Steps[Value]], coming: list[Chunk]) -> None:
        steps, result = read(self.station), None
        try:
            while True:
                request = pull(steps) if result is None else send(steps, result)
                self.requests.append(request)
                result = self._result(request, coming)
        except StopIteration as end:
            self.outcomes.append(end.value)
        except (StationError, LinkFlooded) as error:
            self.outcomes.append((type(error), str(error)))

    def _result(self, request: Request, coming: list[Chunk]) -> IoResult:
        assert isinstance(request, Ask | Listen | Wait)
        if isinstance(request, Ask):
            self.sent = self.now
        until = self.now + request.patience_s if isinstance(request, Ask) else request.until
        if coming and not isinstance(request, Wait) and self.now + coming[0][0] < until:
            after_s, data = coming.pop(0)
            self.now += after_s
            return IoResult(self.now, data, self.sent)
        self.now = until
        return IoResult(self.now, b"", self.sent)

    def known(self) -> list[object]:
        """All that the client knows and has counted."""
        one = self.station
        return [
            self.outcomes,
            *(one.now, one.sent, one.heard, one.exchanges, one.turnaround_s, one.data),
            *(one.strays, one.anomalies.counts, one.garbage_bytes),
            *(one._doubted, one._is_overdue, one._is_clear, one._reader.held),
            _counted(one.flow),
        ]


def _counted(flow: FloodDetector) -> list[object]:
    return [
        *(flow._came + flow.in_order, flow._due + flow.in_order, flow._late, flow._begun),
        *(flow.is_flooded, str(flow.found)),
    ]


NOISE = st.lists(
    st.one_of(
        st.sampled_from([b"\x02", b"\x03", b"\x020100A", b"\x020100ATT1\x03", b"\x00", b"\xff7"]),
        # the second ends in STX
        st.sampled_from([framed("ATT200999"), framed("RSMN", 0, 1), USUAL[:-1] + b"\x00"]),
        st.binary(max_size=3),
    ),
    max_size=3,
).map(b"".join)
ANSWERS = st.sampled_from([USUAL, framed("ATT1-0020"), framed("ATT100ab9")])
REFUSED = framed("NTT100004")


@st.composite
def streams(draw: st.DrawFn) -> bytes:
    """An answer or a refusal, cut off or whole, with noise before it, within it and behind it."""
    answer = draw(st.one_of(ANSWERS, st.just(REFUSED)))
    place = draw(st.integers(0, len(answer)))
    stream = answer[:place] + draw(st.one_of(st.just(b""), NOISE)) + answer[place:]
    return stream[: draw(st.one_of(st.none(), st.integers(0, len(stream))))] + draw(NOISE)


# with their last byte, and not before it, the request is over
ENDING = st.builds(
    lambda noise, answer, bits: noise + answer[:11] + bytes([answer[11] ^ bits]) + answer[12:],
    NOISE,
    ANSWERS,
    st.sampled_from([0, 0, 4]),
)


def cut(stream: bytes, cuts: Sequence[int]) -> list[bytes]:
    places = [0, *sorted({one % (len(stream) + 1) for one in cuts}), len(stream)]
    pieces = [stream[begin:end] for begin, end in pairwise(places)]
    return [piece for piece in pieces if piece]


CUTS = st.lists(st.integers(0, 60), max_size=30)
GAPS = st.lists(st.sampled_from([0.0, 0.0003, 0.004, 0.02, 0.07, 0.3, 1.1]), min_size=1)


@settings(max_examples=200)
@given(streams(), CUTS, GAPS, st.sampled_from([0, 20, 500, 700]), st.sampled_from([0.0, 0.9, 0.99]))
@example(USUAL, [1, 2, 3, 15], [0.0003], 0, 0.0)
@example(USUAL, [7], [0.3], 0, 0.0)  # the rest too late
@example(USUAL, [7], [0.0003, 0.02], 700, 0.99)  # found to be a flood between the pieces
@example(REFUSED, [7], [0.0003], 0, 0.0)
@example(b"x" * 700 + USUAL, [600, 705], [0.0], 0, 0.0)
def test_an_answer_accepted_before_is_read_as_any_other(
    stream: bytes, cuts: list[int], gaps: list[float], unasked: int, wait_s: float
) -> None:
    chunks = [(gaps[n % len(gaps)], piece) for n, piece in enumerate(cut(stream, cuts))]
    before, first = (
        Exchange(chunks, unasked, wait_s, is_first=is_first) for is_first in (False, True)
    )
    assert before.requests == first.requests
    assert before.known() == first.known()


@settings(max_examples=200)
@given(ENDING, CUTS)
@example(USUAL, [*range(1, 16)])
def test_any_split_gives_what_the_whole_gives(stream: bytes, cuts: list[int]) -> None:
    """Where all pieces come at the moment of the whole."""
    first, *more = cut(stream, cuts)
    split = Exchange([(0.001, first), *((0.0, piece) for piece in more)])
    assert split.known() == Exchange([(0.001, stream)]).known()


@pytest.mark.parametrize("size", [1, 2, 5, 8, 15, 16])
def test_an_answer_accepted_before_is_not_examined_again(
    size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    chunks = [(0.0005, USUAL[at : at + size]) for at in range(0, len(USUAL), size)]
    Exchange(chunks)
    matched: list[object] = []
    monkeypatch.setattr(Station, "_match", lambda *given: matched.append(given))
    assert Exchange(chunks).outcomes == [183, 183, 183, 17]
    assert not matched
