"""An answer that was accepted before, whole or in pieces, is not examined again; that gives the
same record as examining it.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

import pytest

from jbclog.protocol.client.question import Question, known_answers
from jbclog.protocol.client.robot import Station
from jbclog.protocol.frame import Frame
from jbclog.transport.virtual import Peer
from support.links.repeating import Repeating
from support.oracles.account import assert_account_holds
from support.virtual.lines import fault, hot_air
from support.virtual.virtual_run import VirtualRun, line_text, prepare

BEGUN_S = 3.0  # the start is over
LINKS = {
    "good": "",
    "lost": fault("silence", at_s=BEGUN_S, every=23),
    "late": fault("late", at_s=BEGUN_S, by_s=0.4, every=31),
    "flipped": fault("flip", at_s=BEGUN_S, every=17),
    "noisy": fault("noise", at_s=BEGUN_S, every=13),
    "refusing": (
        fault("nak", at_s=BEGUN_S, code=4, command="power", every=7)
        + fault("nak", at_s=BEGUN_S, code=2, every=29)
    ),
    "unplugged": fault("dropout", at_s=4.0, for_s=3.0),
    "of all kinds": (
        "".join(
            fault(kind, at_s=BEGUN_S, every=every, **more)
            for kind, every, more in (
                ("silence", 41, {}),
                ("late", 37, {"by_s": 0.3}),
                ("flip", 31, {"bits": 2}),
                ("noise", 29, {}),
                ("nak", 43, {"code": 1}),
            )
        )
        + fault("restart", at_s=9.0, for_s=1.0)
    ),
}


def examine_each(monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """Let clients remember no answer; return those that they would have remembered."""
    forgotten = list[bytes]()
    known_answers.cache_clear()
    monkeypatch.setattr(
        Question, "remember", lambda question, received, data: forgotten.append(received)
    )
    return forgotten


class InPieces:
    """A cable that delivers answers in pieces, as a USB adapter does."""

    def __init__(self, cable: Peer, gap_s: float) -> None:
        self._cable = cable
        self._gap_s = gap_s
        self._random = random.Random(7)

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        coming = list[tuple[float, bytes]]()
        for at, answer in self._cable.receive(data, now):
            size = self._random.choice([1, 5, 8, 15, len(answer)])
            gap_s = self._gap_s * self._random.choice([0.1, 1.0, 1.0, 5.0])
            if self._random.random() < 0.01:
                size, gap_s = len(answer) - 1, 150 * self._gap_s  # too late
            for piece, begin in enumerate(range(0, len(answer), size)):
                coming.append((at + piece * gap_s, answer[begin : begin + size]))
        return coming

    def is_unplugged(self, now: float) -> bool:
        return self._cable.is_unplugged(now)


def in_pieces(link: str, gap_s: float) -> VirtualRun:
    return prepare(
        line_text(f"seed = 3\n{LINKS[link]}"),
        duration_s=12.0,
        rate=5.0 if gap_s else None,
        pulled=lambda _order, session, cable: (session, InPieces(cable, gap_s)),
    )


@pytest.mark.parametrize("link", LINKS)
def test_answers_in_pieces_are_recorded_the_same_when_each_is_examined(
    link: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = recorded(in_pieces(link, 0.001))
    examine_each(monkeypatch)
    assert recorded(in_pieces(link, 0.001)) == short
    assert short[0]


@pytest.mark.parametrize("link", ["good", "flipped", "noisy", "refusing"])
def test_pieces_are_recorded_as_the_whole(link: str) -> None:
    """All pieces come at once."""
    assert recorded(in_pieces(link, 0.0)) == recorded(made("dde", LINKS[link]))


def stopped() -> VirtualRun:
    """Return a run with a host that is suspended between requests and within them, for long and for
    short.
    """
    run = prepare(duration_s=40.0)
    for at_s, for_s in ((4.0, 0.45), (6.003, 0.45), (9.013, 1.3), (15.031, 8.0), (28.05, 6.0)):
        run.at(at_s, lambda s=for_s: run.driver.clock.advance_to(run.driver.clock.monotonic() + s))  # type: ignore[misc]
    return run


def ended(at_s: float) -> VirtualRun:
    run = prepare(duration_s=None)
    run.at(at_s, lambda: run.driver.end("stopped"))
    return run


def flooded() -> VirtualRun:
    """Return a run with floods that end in the pause before a tick, so that the next request meets
    them.
    """
    run = prepare(line_text(keys="ports = [1]"), duration_s=12.0, rate=2.0)
    for second in range(5, 12):
        run.at(second - 0.3, lambda: run.driver.say("dde-1", b"x" * 5000))
    return run


def repeating(gap_s: float, *, torn: bool = False) -> VirtualRun:
    """Return a run on a link that repeats old answers before the true ones."""
    return prepare(
        line_text("seed = 3\nnoise_c = 3.0"),
        duration_s=20.0,
        pulled=lambda _order, session, cable: (
            session,
            Repeating(cable, 0.2, 3, gap_s, torn=torn),
        ),
    )


def recorded(run: VirtualRun) -> list[object]:
    """Return everything that the run recorded, and every question to its station."""
    memory = run.go().memory
    return [
        memory.samples,
        memory.events,
        memory.settings,
        memory.counters,
        memory.stations,
        run.heard,
    ]


def made(family: str, sim: str) -> VirtualRun:
    if family == "jtse":
        return hot_air(f"seed = 3\n{sim}", duration_s=12.0)
    return prepare(line_text(f"seed = 3\n{sim}").replace('"dde"', f'"{family}"'), duration_s=12.0)


@pytest.mark.parametrize("family", ["dde", "ale", "jtse"])
@pytest.mark.parametrize("link", LINKS)
def test_answers_are_recorded_the_same_when_each_is_examined(
    family: str, link: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = recorded(made(family, LINKS[link]))
    requests = examine_each(monkeypatch)
    assert recorded(made(family, LINKS[link])) == short
    assert len(requests) > 100  # else the second run did not go the other way
    assert short[0]


RUNS: dict[str, Callable[[], VirtualRun]] = {
    "flooded": flooded,
    "stopped": stopped,
    "repeating": partial(repeating, 0.01),
    "repeating at once": partial(repeating, 0.0),
    "repeating late": partial(repeating, 0.2),
    "repeating torn": partial(repeating, 0.01, torn=True),
    **{f"ended at {s}": partial(ended, s) for s in (3.0, 3.003, 3.013, 3.031, 3.05, 3.0901)},
}


@pytest.mark.parametrize("name", RUNS)
def test_a_run_is_recorded_the_same_when_each_answer_is_examined(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = RUNS[name]()
    short = recorded(run)
    assert bool(run.memory.of_kind("link.flooded")) == (name == "flooded")
    assert bool(run.memory.of_kind("host.suspended")) == (name == "stopped")
    assert_account_holds(run)
    examine_each(monkeypatch)
    assert recorded(RUNS[name]()) == short


@pytest.mark.parametrize("pieces", [False, True])
def test_a_good_answer_is_examined_once(pieces: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    match, matched = Station._match, list[str]()

    def counted(station: Station, question: Question, frame: Frame) -> str | None:
        matched.append(frame.text)
        return match(station, question, frame)

    def made_run() -> VirtualRun:
        return in_pieces("good", 0.0005) if pieces else prepare(duration_s=60.0)

    made_run().go()
    monkeypatch.setattr(Station, "_match", counted)
    run = made_run().go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert len(matched) < len(run.memory.samples) / 10, Counter(matched)
