"""Late answers: they look like fresh ones, so after any doubt another code is answered first
(docs/reference/faults.md, F-5).

The plant of these tests changes with each question: its n-th temperature is n. So a value is fresh
only where it is the number of times that the temperature has been asked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest

from support.clients.talk import PROMPT_S, Answer, Talk, framed, sought
from support.product import (
    FAMILIES,
    LEAST_S,
    LINK_QUIET_S,
    UNMEASURED_S,
    LineFormat,
    LinkFlooded,
    Station,
    StationError,
    StationSilent,
    least_s,
)

DDE = FAMILIES["dde"].commands
TIP, MODEL, SELECTED = DDE["tip_temperature"], DDE["model"], DDE["selected_temperature"]
OTHERS = {"RSMN": "ASMN  DDE", "RSER": "ASER00000", "RMAT": "AMAT00500"}
# framed like the answer, wrong check byte
NOT_ONE_BIT = bytes([0x02, *b"0100ATT100001", 0x03, 0x55])
BEFORE: dict[str, list[Answer]] = {
    "nothing": [],
    "echo": [(0.006, framed("RTT1", 0, 1))],
    "another station": [(0.010, framed("ATT100999", 7, 0))],
    "rubbish like a frame": [(0.010, NOT_ONE_BIT)],
}
LATENESS_S = [PROMPT_S, 0.05, *(0.1 + 0.013 * step for step in range(80))]


class Plant:
    """Answers the temperature with how often it was asked, as late as `lateness` says for that
    question.
    """

    def __init__(self, lateness: Callable[[int], float], before: list[Answer]) -> None:
        self.asked: Counter[str] = Counter()
        self._lateness = lateness
        self._before = before

    def replies(self, text: str) -> list[Answer]:
        self.asked[text] += 1
        if text == "RTT1":
            number = self.asked[text]
            return [*self._before, (self._lateness(number), f"ATT1{number:05d}")]
        return [*self._before, OTHERS[text]]


def stale_values(plant: Plant, reads: int = 8) -> list[tuple[object, int]]:
    """Read the temperature again and again, as a run would; each value that was not the last
    question's.
    """
    stale = []

    async def all_reads(station: Station) -> None:
        for _ in range(reads):
            try:
                value = await station.read(TIP, 1)
            except StationSilent:
                await sought(station, MODEL)
            except StationError:
                continue
            else:
                if value != plant.asked["RTT1"]:
                    stale.append((value, plant.asked["RTT1"]))

    Talk(replies=plant.replies).do(all_reads)
    return stale


@pytest.mark.parametrize("before", BEFORE)
@pytest.mark.parametrize(
    "late",
    [lambda n: n == 1, lambda n: n in (3, 4, 5), lambda n: n % 2 == 0],
    ids=["first", "series", "each second"],
)
def test_no_value_is_ever_a_late_answer(before: str, late: Callable[[int], bool]) -> None:
    for by_s in LATENESS_S:
        plant = Plant(lambda n, by_s=by_s: by_s if late(n) else PROMPT_S, BEFORE[before])
        assert stale_values(plant) == [], f"{by_s:.3f} s late"


@pytest.mark.parametrize("lost", ["RTT1", "RSMN", "RSER"])
def test_another_code_is_answered_before_the_same_code_is_asked_again(lost: str) -> None:
    heard: list[str] = []

    def replies(text: str) -> list[Answer]:
        heard.append(text)
        first = heard.count(text) == 1 and text == lost
        return (
            [] if first else [{"RTT1": "ATT100183", "RSMN": "ASMN  DDE", "RSER": "ASER00000"}[text]]
        )

    command = next(command for command in DDE.values() if command.letters == lost[1:4].rstrip("1"))
    Talk(replies=replies).do(lambda station: station.read(command, 1 if lost == "RTT1" else None))
    assert heard[0] == heard[-1] == lost
    assert heard[1] != lost


def test_a_late_answer_is_dropped_while_another_code_is_out() -> None:
    talk = Talk(("RTT1", (0.35, "ATT100111")), ("RSMN", (0.01, "ASMN  DDE")), ("RTT1", "ATT100183"))
    assert talk.do(lambda station: station.read(TIP, 1)) == 183
    assert talk.station.strays == {"code": 1}


def test_nothing_is_asked_before_the_line_is_quiet_again() -> None:
    """What comes after the time is over is let go by first."""
    dribble: list[Answer] = [(0.320 + 0.010 * step, b"\x02010") for step in range(10)]
    talk = Talk(("RTT1", *dribble), ("RSMN", "ASMN  DDE"), ("RTT1", "ATT100183"))
    assert talk.do(lambda station: station.read(TIP, 1)) == 183
    asked, probed, _ = talk.end.moments
    assert probed - asked >= 0.410 + LINK_QUIET_S
    assert talk.station.strays["late"] == 10


def test_a_late_answer_to_an_earlier_probe_proves_nothing() -> None:
    """The probe that settles a doubt may itself have been asked before: what answers it then may be
    that one's answer.
    """
    asked: Counter[str] = Counter()

    def replies(text: str) -> list[Answer]:
        asked[text] += 1
        said = f"ASER{asked[text]:05d}" if text == "RSER" else OTHERS.get(text, "ATT100183")
        late = {("RSMN", 1): 0.80, ("RSER", 1): 0.60}.get((text, asked[text]), PROMPT_S)
        echo: list[Answer] = (
            [(0.006, framed(text, 0, 1))] if (text, asked[text]) == ("RSER", 1) else []
        )
        return [] if (text, asked[text]) == ("RTT1", 1) else [*echo, (late, said)]

    talk = Talk(replies=replies)

    async def reads(station: Station) -> object:
        with pytest.raises(StationError):
            await station.read(TIP, 1)
        return await station.read(DDE["station_error"])

    value = talk.do(reads)
    assert asked["RSMN"] > 1
    assert value == asked["RSER"] > 1


def test_a_silent_station_is_given_up_after_three_questions() -> None:
    talk = Talk(replies=lambda text: [])
    with pytest.raises(StationSilent):
        talk.do(lambda station: station.read(TIP, 1))
    assert talk.end.heard == ["RTT1", "RSMN", "RSER"]


@pytest.mark.parametrize(("is_written_to", "again_as"), [(False, 66), (True, 67)])
def test_a_question_is_asked_again_once_64_later_ones_were_not_answered(
    is_written_to: bool, again_as: int
) -> None:
    """No station queues more of them, so its answer does not come any more. Two probes follow each
    other, and a write shifts them by one.
    """
    talk = Talk(replies=lambda text: [])

    async def reads(station: Station) -> None:
        for number in range(40):
            with pytest.raises(StationError):
                await station.read(TIP, 1)
            if number == 0 and is_written_to:
                with pytest.raises(StationError):
                    await station.write(SELECTED, 350, 1)

    talk.do(reads)
    asked = [number for number, text in enumerate(talk.end.heard, 1) if text == "RTT1"]
    assert asked == [1, again_as]


def test_an_echo_is_no_proof_that_a_station_is_there() -> None:
    """A loop-back plug, or a line of which only the adapter is left."""
    talk = Talk(replies=lambda text: [framed(text, 0, 1)])
    with pytest.raises(StationError):
        talk.do(lambda station: station.read(TIP, 1))
    assert talk.end.heard.count("RTT1") == 1  # the probes were echoed too, and answered by nobody


# -- how long is waited ----------------------------------------------------------------------------


def waited_s(line: LineFormat, seen_s: float | None) -> float:
    """How long the client waits for a temperature that does not come, beyond its bytes."""
    station = Station(line)
    station.turnaround_s = seen_s
    question = station.question(TIP, 1)
    return station.patience_s(question) - line.seconds(27)


@pytest.mark.parametrize("baudrate", [1200, 9600, 19200, 500000])
def test_the_time_allowed_follows_from_bytes_line_and_turnaround(baudrate: int) -> None:
    line = LineFormat(baudrate)
    assert waited_s(line, None) == pytest.approx(UNMEASURED_S)
    assert waited_s(line, 0.001) == pytest.approx(LEAST_S)
    assert waited_s(line, 0.2) == pytest.approx(0.8)


def test_a_write_is_allowed_longer_and_teaches_nothing_of_reads() -> None:
    """What it is stored in may be slow (docs/reference/contradictions.md, B-13)."""
    talk = Talk(("RTT1", "ATT100183"), ("WST100360", (0.9, "AST1")), ("RTT1", "ATT100184"))

    async def steps(station: Station) -> float | None:
        await station.read(TIP, 1)
        seen = station.turnaround_s
        await station.write(SELECTED, 360, 1)
        await station.read(TIP, 1)
        return seen

    assert talk.do(steps) == pytest.approx(talk.station.turnaround_s, rel=0.01)
    assert talk.end.heard == ["RTT1", "WST100360", "RTT1"]


@pytest.mark.parametrize(
    ("command", "at_least_s"), [("selected_temperature", 1.0), ("status", 1.0), ("restart", 2.0)]
)
def test_what_is_stored_for_good_is_waited_for_longest(command: str, at_least_s: float) -> None:
    assert least_s(FAMILIES["dde"].commands[command]) == at_least_s


def test_the_turnaround_is_learnt_from_answers() -> None:
    talk = Talk(
        ("RTT1", (0.0140625 + 0.060, "ATT100183")), ("RTT1", (0.0140625 + 0.002, "ATT100184"))
    )
    talk.each(lambda station: station.read(TIP, 1), lambda station: station.read(TIP, 1))
    assert talk.station.turnaround_s == pytest.approx(0.060, rel=0.01)


@pytest.mark.parametrize(
    ("every_s", "size", "error"), [(0.005, 50, LinkFlooded), (0.015, 2, StationError)]
)
def test_a_line_that_never_falls_silent_ends_the_waiting(
    every_s: float, size: int, error: type[Exception]
) -> None:
    """A babbling device: bounded time, bounded memory. Ten times an answer in a second is a
    flood.
    """
    babble = [(every_s * step, b"\xaa" * size) for step in range(4000)]
    talk = Talk(
        replies=lambda text: babble if text == "RTT1" and talk.end.heard == ["RTT1"] else []
    )
    before = talk.clock.monotonic()
    with pytest.raises(error):
        talk.do(lambda station: station.read(TIP, 1))
    assert talk.clock.monotonic() - before < 5
