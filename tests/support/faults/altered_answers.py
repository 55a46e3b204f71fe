"""One answer of a run replaced by what two flipped bits can make of it so that it passes; and what
a run decides.

`Bench` is a station of a family with a short run on it; `spoilt` lives through that run with one
answer spoilt, `clean` with none.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

from support.clients.corrupted import flipped, taken_by_omega, taken_of_two_bits
from support.product import FAMILIES, OMEGA_PROTOCOL, Command, OmegaReader, Value, sim_questions
from support.virtual.lines import AIR
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

SIM = "joints_per_minute = 0\nseed = 5\n"
FEEDER = (
    RECIPE
    + "\n[feeder]\nlength_mm = 4.0\nspeed_mm_s = 8.0\nbackward_mm = 0.5\nclog_detection = true\n"
)
CONTROLLER = """
[recipe]
name = "test"
revision = 1
families = ["omega"]

[omega]
condition = 101
mode = 0
rise_s = 0.3
feed1_mm = 2.0
feed1_mm_s = 10.0
reverse1_mm = 0.5
reverse1_mm_s = 10.0
preheat_s = 0.8
feed2_mm = 3.0
feed2_mm_s = 8.0
reverse2_mm = 0.5
reverse2_mm_s = 10.0
heating_s = 1.0
feed3_mm = 0.0
feed3_mm_s = 0.0
reverse3_mm = 1.0
reverse3_mm_s = 20.0
"""


@dataclass(frozen=True)
class Bench:
    """A station with one port and a run of so many seconds on it."""

    family: str
    recipe: str = RECIPE
    sim: str = SIM
    keys: str = "ports = [1]"
    seconds: float = 3.0

    @property
    def is_omega(self) -> bool:
        return FAMILIES[self.family].protocol == OMEGA_PROTOCOL

    def prepare(self) -> VirtualRun:
        line = line_text(self.sim, self.keys).replace("dde", self.family)
        if self.is_omega:
            line = line.replace("turnaround_ms = 1.0\n", "")
        return prepare(line, self.recipe, duration_s=self.seconds)


BENCHES = {
    bench.family: bench
    for bench in (
        Bench("dde"),
        Bench("soldering"),
        Bench("ucr"),
        Bench("ale", FEEDER),
        Bench("jtse", AIR, SIM + "tool = 1\n"),
        Bench("omega", CONTROLLER, SIM, "", 6.0),
    )
}
"""A family of each kind: NAE, DME and HDE have DDE's table."""


# -- what two flipped bits can make of an answer ---------------------------------------------------


@lru_cache(8192)
def corruptions(family: str, question: str, answer: bytes) -> list[tuple[bytes, Value]]:
    """Every corruption of two bits that passes for an answer to ``question`` (``RTT1``, ``C0065``)
    and says something else.
    """
    if FAMILIES[family].protocol == OMEGA_PROTOCOL:
        return _of_omega(family, question, answer)
    asked = sim_questions(family, (1,))[question]
    right = asked.command.quantity.decode(answer[5 + len(question) : -2].decode("ascii"))
    found = taken_of_two_bits(asked.command, asked.port, asked.tool, answer)
    return [(sent, value) for sent, value in found if value != right]


def _of_omega(family: str, question: str, answer: bytes) -> list[tuple[bytes, Value]]:
    command = _command_of_omega(family, question)
    right = taken_by_omega(command, answer)
    framed = (
        sent
        for sent in flipped(answer, 2)
        if any(isinstance(one, str) for one in OmegaReader().feed(sent))
    )
    found = [(sent, taken_by_omega(command, sent)) for sent in framed]
    return [(sent, value) for sent, value in found if value is not None and value != right]


def _command_of_omega(family: str, question: str) -> Command:
    command = next(one for one in FAMILIES[family].commands.values() if one.letters == question[0])
    return command.numbered(int(question[1:], 16)) if len(question) > 1 else command


# -- runs ------------------------------------------------------------------------------------------


class Spoiler:
    """Spoils the n-th answer (from 0) to one question; ``which`` of its corruptions counts round.
    Counts what it did.
    """

    def __init__(
        self, run: VirtualRun, family: str, question: str = "", place: int = -1, which: int = 0
    ) -> None:
        self.family, self.question, self.place, self.which = family, question, place, which
        self.asked: Counter[str] = Counter()
        self.first: dict[str, bytes] = {}  # the first answer to each question
        self.spoilt = 0
        self.choices = 0  # corruptions of the answer that was chosen
        self._tap = next(iter(run.taps.values()))
        self._receive = self._tap.receive
        self._tap.receive = self.receive  # type: ignore[method-assign]

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        replies = self._receive(data, now)
        text = self._tap.heard[-1].text
        self.asked[text] += 1
        if replies:
            self.first.setdefault(text, replies[0][1])
        if text != self.question or self.asked[text] != self.place + 1:
            return replies
        ((at, answer),) = replies
        choice = corruptions(self.family, text, answer)
        self.choices = len(choice)
        if not choice:
            return replies
        self.spoilt += 1
        return [(at, choice[self.which % len(choice)][0])]


def spoilt(
    family: str, question: str = "", place: int = -1, which: int = 0
) -> tuple[VirtualRun, Spoiler]:
    run = BENCHES[family].prepare()
    spoiler = Spoiler(run, family, question, place, which)
    return run.go(), spoiler


@cache
def clean(family: str) -> tuple[VirtualRun, Spoiler]:
    return spoilt(family)


def asked(family: str) -> list[str]:
    """Every question that the run on a clean line asks and that is answered with a value."""
    first = clean(family)[1].first
    if BENCHES[family].is_omega:
        return sorted(first)
    return sorted(text for text, answer in first.items() if text[0] == "R" and answer[5:6] == b"A")


def places(family: str, question: str) -> list[int]:
    """The first askings of a question, one in the middle, and the last ones."""
    times = clean(family)[1].asked[question]
    return sorted({0, 1, 2, times // 2, times - 2, times - 1} & set(range(times)))


def decided(run: VirtualRun) -> dict[str, object]:
    """What a run decides: what it wrote and found set, what it counted, which tool it met, how it
    ended.
    """
    return {
        "settings": [one[2:] for one in run.memory.settings],
        "counters": [one[2:] for one in run.memory.counters],
        "writes": [one.text for one in run.writes],
        "outcome": (run.facts.outcome, run.facts.reason),
        "tool_names": run.facts.tool_names,
        "model": (run.facts.model, run.facts.software),
        "safe": run.facts.safe_state,
        "alarms": run.facts.alarms,
        "not supported": run.facts.not_supported,
    }
