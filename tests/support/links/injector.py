"""Something on the wire between a station and its client: answers come late, twice, merged, torn,
foreign or not at all.

`Injector` stands in front of a far end. What it does to the answer of the n-th question is in its
plan; what it did is in `did`. `forged` are the whole answers of this station that it let come at
another moment than their own: nothing in one tells it from an answer to the same question asked
again, so where it comes right then it is believed (docs/reference/faults.md, I4). They are
kept so that a test can count them: recorded is what was injected, and nothing else.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from support.golden import framed

Receive = Callable[[bytes, float], Sequence[tuple[float, bytes]]]
OTHER_ADDRESS, HOST = 2, 0
# the binary one of the same socket (DLE, NAK)
OTHER_PROTOCOL = bytes([0x10, 0x02, 0x15, 0x10, 0x03, 0x15, 0x10, 0x15])
EARLY_S = 0.002  # how long before the answer something foreign comes


@dataclass(frozen=True)
class Deed:
    """What is done to one answer. `by_s` is a delay; `part` says where a frame is torn, from 0 to
    1; `instead`: the answer itself does not come at all.
    """

    kind: str
    by_s: float = 0.0
    part: float = 0.5
    instead: bool = False


@dataclass(frozen=True)
class Forged:
    """An answer at another moment than its own: the question that it would answer, its data, and
    when it comes.
    """

    question: str
    data: str
    at: float


@dataclass
class Injector:
    """A far end with a plan: number of the question -> what becomes of its answer."""

    receive_clean: Receive
    plan: Mapping[int, Deed]
    is_out: Callable[[float], bool] = lambda now: False
    number: int = -1
    did: Counter[str] = field(default_factory=Counter)
    forged: list[Forged] = field(default_factory=list)
    _free: float = 0.0  # when the wire is free again: no answer overtakes another
    _kept: bytes = b""
    _said: bytes = b""

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        self.number += 1
        replies = list(self.receive_clean(data, now))
        deed = self.plan.get(self.number)
        if len(replies) != 1:
            return replies
        at, answer = max(replies[0][0], self._free), replies[0][1]
        self._free = at
        kept, self._kept = self._kept, b""
        before, self._said = self._said, answer
        if deed is None:
            return [(at, kept + answer)]
        self.did[deed.kind] += 1
        done = self._do(deed, data, at, answer, before)
        return [(at, kept), *done] if kept else done

    def is_unplugged(self, now: float) -> bool:
        return self.is_out(now)

    # -- the deeds ---------------------------------------------------------------------------------

    def _do(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        done: list[tuple[float, bytes]] = getattr(self, f"_{deed.kind}")(
            deed, data, at, answer, before
        )
        return done

    def _lost(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        return []

    def _late(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        self._free = at + deed.by_s
        return [(self._free, answer)]

    def _twice(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        self._forge(at + deed.by_s, answer)
        return [(at, answer), (at + deed.by_s, answer)]

    def _merged(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        """It comes in one piece with the next one."""
        self._kept = answer
        return []

    def _torn(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        cut = min(max(1, round(deed.part * len(answer))), len(answer) - 1)
        self._free = at + deed.by_s
        return [(at, answer[:cut]), (self._free, answer[cut:])]

    def _cut_short(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        """The rest never comes."""
        return [(at, answer[: round(deed.part * len(answer))])]

    def _echo(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        return self._with(data, deed, at, answer)

    def _other_address(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        """Another station on the line answers the same, and something else."""
        return self._with(
            framed(_raised(_text(answer)), f"{OTHER_ADDRESS:02d}{HOST:02d}"), deed, at, answer
        )

    def _other_framing(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        """One without addresses where there are some, and the other way round."""
        addresses = "" if _addresses(answer) else "0100"
        return self._with(framed(_raised(_text(answer)), addresses), deed, at, answer)

    def _other_port(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        text = _text(answer)
        foreign = (
            _like(answer, _of_other_port(_raised(text))) if text[-5:].isdigit() else OTHER_PROTOCOL
        )
        return self._with(foreign, deed, at, answer)

    def _other_signal(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        """The answer to the question before, if that was another one."""
        foreign = before if _text(before)[1:-5] != _text(answer)[1:-5] else b""
        return self._with(foreign, deed, at, answer)

    def _foreign(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        return self._with(OTHER_PROTOCOL, deed, at, answer)

    def _foreign_within(
        self, deed: Deed, data: bytes, at: float, answer: bytes, before: bytes
    ) -> list[tuple[float, bytes]]:
        cut = round(deed.part * len(answer))
        return [(at, answer[:cut] + OTHER_PROTOCOL + answer[cut:])]

    def _with(
        self, foreign: bytes, deed: Deed, at: float, answer: bytes
    ) -> list[tuple[float, bytes]]:
        """Something before the answer, behind it (`by_s`), or in its place."""
        comes = at - EARLY_S if deed.instead or not deed.by_s else at + deed.by_s
        if _addresses(foreign) == _addresses(answer):
            self._forge(comes, foreign)
        return [(comes, foreign)] if deed.instead else [(comes, foreign), (at, answer)]

    def _forge(self, at: float, answer: bytes) -> None:
        text = _text(answer)
        self.forged.append(Forged(f"R{text[1:-5]}".rstrip(), text[-5:], at))


KINDS = (
    "lost",
    "late",
    "twice",
    "merged",
    "torn",
    "cut_short",
    "echo",
    "other_address",
    "other_framing",
    "other_port",
)
KINDS += ("other_signal", "foreign", "foreign_within")
FORGING = ("twice", "other_port", "other_signal")
"""Those by which whole answers of this station come at moments that are not theirs."""


def _text(wire: bytes) -> str:
    """Header, code and data of a frame, its addresses left out; nothing of nothing."""
    body = wire[1:-2].decode("ascii", "replace")
    return body[4:] if body[:1].isdigit() else body


def _raised(text: str) -> str:
    """The text with another number in it."""
    code, data = text[:-5], text[-5:]
    return f"{code}{(int(data) + 50_000) % 100_000:05d}" if data.isdigit() else text


def _of_other_port(text: str) -> str:
    """The same of the other port: ``ATT100183`` to ``ATT200183``; what has none gets one:
    ``ATT00045`` to ``ATT100045``.
    """
    code, data = text[:-5], text[-5:]
    return {"1": code[:-1] + "2", "2": code[:-1] + "1"}.get(code[-1:], code + "1") + data


def _like(answer: bytes, text: str) -> bytes:
    return framed(text, _addresses(answer))


def _addresses(wire: bytes) -> str:
    return wire[1:5].decode("ascii") if wire[1:2].isdigit() else ""
