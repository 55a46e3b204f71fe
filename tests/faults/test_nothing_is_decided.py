"""One answer that two flipped bits have made another decides nothing: no setting, no counter, no alarm, no write, no end.

Each question that a run asks is answered wrongly once, with bytes that really pass for an answer to it; the run must then
leave the same settings, counters and writes behind as one on a clean line.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache

import pytest
from account import assert_account_holds
from corrupted import taken_of_two_bits
from virtual_run import VirtualRun, line_text, prepare

from jbclog.quantities import Value
from jbclog.sim.questions import questions

SECONDS = 3.0
SIM = "joints_per_minute = 0\nseed = 5\n"
ASKED = questions("dde", (1,))


@lru_cache(4096)
def corruptions(code: str, answer: bytes) -> list[tuple[bytes, Value]]:
    """What two flipped bits can make of an answer so that it passes, and says something else."""
    asked = ASKED[f"R{code}"]
    right = asked.command.quantity.decode(answer[5 + 1 + len(code) : -2].decode("ascii"))
    found = taken_of_two_bits(asked.command, asked.port, asked.tool, answer)
    return [(sent, value) for sent, value in found if value != right]


class Spoiler:
    """Spoils the n-th answer to one question; ``which`` of its corruptions (from 0) counts round. Counts what it did."""

    def __init__(self, run: VirtualRun, code: str = "", place: int = -1, which: int = 0) -> None:
        self.run, self.code, self.place, self.which = run, code, place, which
        self.asked: Counter[str] = Counter()
        self.spoilt = 0
        tap = next(iter(run.taps.values()))
        self._receive = tap.receive
        tap.receive = self.receive  # type: ignore[method-assign]

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        replies = self._receive(data, now)
        text = data[5:-2].decode("ascii")
        self.asked[text] += 1
        if text != f"R{self.code}" or self.asked[text] != self.place + 1:
            return replies
        ((at, answer),) = replies
        choice = corruptions(self.code, answer)
        if not choice:
            return replies
        self.spoilt += 1
        return [(at, choice[self.which % len(choice)][0])]


def run_with(code: str = "", place: int = -1, which: int = 0) -> tuple[VirtualRun, Spoiler]:
    run = prepare(line_text(SIM, "ports = [1]"), duration_s=SECONDS)
    spoiler = Spoiler(run, code, place, which)
    return run.go(), spoiler


@lru_cache
def clean() -> tuple[VirtualRun, Spoiler]:
    return run_with()


def decided(run: VirtualRun) -> dict[str, object]:
    """What a run decides: what it wrote and found set, what it counted, which tool it met, how it ended."""
    return {
        "settings": [one[2:] for one in run.memory.settings],
        "counters": [one[2:] for one in run.memory.counters],
        "writes": [one.text for one in run.writes],
        "outcome": (run.facts.outcome, run.facts.reason),
        "tools": run.facts.tools,
        "model": (run.facts.model, run.facts.software),
        "safe": run.facts.safe_state,
        "alarms": run.facts.alarms,
        "not supported": run.facts.not_supported,
    }


def codes() -> list[str]:
    """Everything that the run on a clean line reads."""
    return sorted(text[1:] for text in clean()[1].asked if text.startswith("R"))


def places(code: str) -> list[int]:
    """The first askings of a question, one in the middle, and the last ones."""
    times = clean()[1].asked[f"R{code}"]
    return sorted({0, 1, 2, times // 2, times - 2, times - 1} & set(range(times)))


def check(code: str, place: int, which: int) -> None:
    run, spoiler = run_with(code, place, which)
    said = f"{code}, asking {place}, corruption {which}"
    assert decided(run) == decided(clean()[0]), said
    assert_account_holds(run)
    told = {event.kind for event in run.memory.events}
    assert not told & {"setting.changed", "tool.changed", "identity.changed", "alarm.high", "alarm.low", "port.error"}, said
    assert not told & {"station.error", "safety.not_safe", "link.lost"}, said
    assert run.facts.unconfirmed_alarms <= (code == "TA1"), said
    assert spoiler.spoilt or not corruptions_of_first(code), said


def corruptions_of_first(code: str) -> bool:
    """Whether anything passes for an answer to this question; nothing does where only one value can be read."""
    tap = next(iter(clean()[0].taps.values()))
    first = next(one for one in tap.heard if one.text == f"R{code}")
    return first.clean is not None and first.clean.startswith("A") and bool(corruptions(code, _answer(first.clean)))


def _answer(text: str) -> bytes:
    covered, check = b"\x020100" + text.encode("ascii") + b"\x03", 0
    for byte in covered:
        check ^= byte
    return covered + bytes([check])


@pytest.mark.parametrize("code", codes())
def test_a_wrong_answer_decides_nothing(code: str) -> None:
    for place in places(code):
        check(code, place, which=place)


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("code", codes())
def test_no_wrong_answer_decides_anything(code: str) -> None:
    """Every corruption that passes, at each of the places."""
    tap = next(iter(clean()[0].taps.values()))
    first = next(one for one in tap.heard if one.text == f"R{code}")
    count = len(corruptions(code, _answer(first.clean or ""))) if first.clean else 0
    for place in places(code):
        for which in range(count):
            check(code, place, which)
