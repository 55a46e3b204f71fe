"""Lets a virtual JBC station answer a question otherwise, as an answer does in which two bits were
turned over unseen.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Answer = Callable[[str, str, float], tuple[str, str] | None]


class Device(Protocol):
    """What of a virtual station answers: header and text of a question, and the moment; header and
    text of the answer.
    """

    answer: Answer


def let_say(device: Device, code: str, *data: str, last: bool = False) -> None:
    """Answer R-`code` with these data fields first; with `last`, with the last of them ever after.
    "" is the true answer.
    """
    ask, coming = device.answer, list(data)

    def answer(header: str, text: str, now: float) -> tuple[str, str] | None:
        if (header, text) != ("R", code) or not coming:
            return ask(header, text, now)
        said = coming[0] if last and len(coming) == 1 else coming.pop(0)
        return ("A", code + said) if said else ask(header, text, now)

    device.answer = answer
