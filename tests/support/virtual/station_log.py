"""What virtual stations noted of their wires (`jbclog sim --log`, or a `WireFile`), as questions
with their answers.
"""

from __future__ import annotations

import json
import re
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from support.virtual.virtual_run import Heard

FRAME = re.compile(rb"\x02(?:\d{4})?([RWAN][ -~]*)\x03[\x00-\xff]", re.DOTALL)


@dataclass
class _Side:
    """One direction of one wire: pieces of frames come in, whole texts with the moment of their
    last byte go out.
    """

    held: bytes = b""

    def texts(self, data: bytes) -> Iterator[str]:
        self.held += data
        end = 0
        for frame in FRAME.finditer(self.held):
            end = frame.end()
            yield frame[1].decode("ascii")
        self.held = self.held[end:]


@dataclass
class _Wire:
    """What passed on one wire; a question waits here for its answer."""

    asked: _Side = field(default_factory=_Side)
    said: _Side = field(default_factory=_Side)
    heard: list[Heard] = field(default_factory=list)
    waiting: deque[int] = field(default_factory=deque)

    def question(self, at: float, data: bytes) -> None:
        for text in self.asked.texts(data):
            self.waiting.append(len(self.heard))
            self.heard.append(Heard(at, text, None, None))

    def answer(self, data: bytes) -> None:
        for text in self.said.texts(data):
            for place in self.waiting:
                question = self.heard[place]
                if is_answer(text, question.text):
                    self.heard[place] = Heard(question.at, question.text, text, text)
                    self.waiting.remove(place)
                    break


def is_answer(text: str, question: str) -> bool:
    """Whether `text` can be the answer to `question`: its code is the beginning of the one, or all
    of the other.
    """
    return text[:1] in "AN" and (
        text[1:].startswith(question[1:])
        if question[0] == "R"
        else question[1:].startswith(text[1:4])
    )


def heard_in(path: Path, begin: int = 0) -> dict[str, list[Heard]]:
    """By station: every question in the order of time, in monotonic seconds, with the answer that
    went out, if one did.

    `begin`: the size that the file had when the run began that is looked at.
    """
    wires: dict[str, _Wire] = {}
    for line in path.read_bytes()[begin:].decode("ascii").splitlines():
        one = json.loads(line)
        wire = wires.setdefault(one["station"], _Wire())
        if one["kind"] == "question":
            wire.question(one["t"], bytes.fromhex(one["hex"]))
        elif one["kind"] == "answer":
            wire.answer(bytes.fromhex(one["hex"]))
    return {station: wire.heard for station, wire in wires.items()}
