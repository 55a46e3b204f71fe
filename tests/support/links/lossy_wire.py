"""A wire on which each frame has the same small chance of each of nine accidents, at the same time
and on all stations.

A share of 0.01 means: of a hundred questions one is lost, of another the answer is lost, another is
flipped in one bit, and so on through `ACCIDENTS`: nine in a hundred. Nothing here knows what a
session does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from random import Random

from support.golden import framed
from support.virtual.virtual_run import Tap

ACCIDENTS = (
    "lost_there",
    "lost_back",
    "flipped",
    "late",
    "refused_n1",
    "doubled",
    "cut",
    "behind_noise",
    "other_address",
)
LATE_S = 1.5  # an answer that is late comes so much later at the most
N1 = "00001"

Replies = Sequence[tuple[float, bytes]]


@dataclass
class LossyWire:
    """It lies between a session and the tap of a virtual station; `did` counts what happened."""

    tap: Tap
    random: Random
    share: float
    did: Counter[str] = field(default_factory=Counter)
    frames: int = 0

    def is_unplugged(self, now: float) -> bool:
        return self.tap.is_unplugged(now)

    def receive(self, data: bytes, now: float) -> Replies:
        self.frames += 1
        place = int(self.random.random() / self.share)
        if place >= len(ACCIDENTS):
            return self.tap.receive(data, now)
        self.did[ACCIDENTS[place]] += 1
        happened: Replies = getattr(self, f"_{ACCIDENTS[place]}")(data, now)
        return happened

    def _lost_there(self, data: bytes, now: float) -> Replies:
        return []

    def _lost_back(self, data: bytes, now: float) -> Replies:
        self.tap.receive(data, now)
        return []

    def _flipped(self, data: bytes, now: float) -> Replies:
        """One bit of the question or of the answer."""
        if self.random.random() < 0.5:
            return self.tap.receive(self._one_bit(data), now)
        return [(at, self._one_bit(answer)) for at, answer in self.tap.receive(data, now)]

    def _late(self, data: bytes, now: float) -> Replies:
        by_s = self.random.uniform(0.0, LATE_S)
        return [(at + by_s, answer) for at, answer in self.tap.receive(data, now)]

    def _refused_n1(self, data: bytes, now: float) -> Replies:
        """The station says that the check byte was wrong: mostly nothing was done, but its answer
        may be lost to another.
        """
        addresses, text = _parts(data)
        if self.random.random() < 0.5:
            self.tap.receive(data, now)
        code = text[1:] if text[:1] == "R" else text[1:-5]
        return [(now + 0.02, framed(f"N{code}{N1}", addresses[2:] + addresses[:2]))]

    def _doubled(self, data: bytes, now: float) -> Replies:
        """The question, which is then answered twice, or the answer."""
        replies = list(self.tap.receive(data, now))
        if self.random.random() < 0.5 and replies:
            return replies + list(self.tap.receive(data, replies[-1][0]))
        return [*replies, *((at + 0.003, answer) for at, answer in replies)]

    def _cut(self, data: bytes, now: float) -> Replies:
        """What was left of the question, or of the answer."""
        if self.random.random() < 0.5:
            return self.tap.receive(data[: self.random.randrange(1, len(data))], now)
        return [
            (at, answer[: self.random.randrange(1, len(answer))])
            for at, answer in self.tap.receive(data, now)
        ]

    def _behind_noise(self, data: bytes, now: float) -> Replies:
        noise = self.random.randbytes(self.random.randint(1, 40))
        if self.random.random() < 0.5:
            return self.tap.receive(noise + data, now)
        return [(at, noise + answer) for at, answer in self.tap.receive(data, now)]

    def _other_address(self, data: bytes, now: float) -> Replies:
        """Another station's answer to the same question, in place of this one's or before it."""
        replies = list(self.tap.receive(data, now))
        foreign = [
            (at - 0.002, framed(_raised(_parts(answer)[1]), "0200"))
            for at, answer in replies
            if len(answer) > 6
        ]
        return foreign if self.random.random() < 0.5 else [*foreign, *replies]

    def _one_bit(self, frame: bytes) -> bytes:
        place, bit = self.random.randrange(len(frame)), self.random.randrange(8)
        return frame[:place] + bytes([frame[place] ^ 1 << bit]) + frame[place + 1 :]


def _parts(frame: bytes) -> tuple[str, str]:
    """Addresses, empty where there are none, and the text of a frame."""
    body = frame[1:-2].decode("ascii", "replace")
    return (body[:4], body[4:]) if body[:1].isdigit() else ("", body)


def _raised(text: str) -> str:
    """An answer with another number in it."""
    data = text[-5:]
    return (
        f"{text[:-5]}{(int(data) + 7) % 100_000:05d}" if data.isdigit() and data.isascii() else text
    )
