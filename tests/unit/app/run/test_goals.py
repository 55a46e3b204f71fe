"""Runs that end with a number of units or joints: when they end, and what is said where they come
short of it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from jbclog.app.run import goals as goals_of_a_run
from jbclog.app.run.goals import LAST_COUNT_S, LEAST_PAUSE_S, MOST_PAUSE_S, Goals, pause_s
from jbclog.app.run.options import Metadata, RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.app.run.unit_feed import LOOK_EVERY_S, UnitFeed
from jbclog.core.errors import Problems
from jbclog.core.goal import Goal
from jbclog.core.outcome import Exit, exit_code, findings
from jbclog.core.rows import Severity
from jbclog.live.joint_numbers import Counted, JointCounting, PortCount
from jbclog.transport.typed_lines import LineSource
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare


@dataclass
class Told:
    """What goals tell, and with what they end the run."""

    ends: list[str] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)

    def tell(self, kind: str, _text: str, _severity: Severity, _value: float | None) -> None:
        self.kinds.append(kind)


# -- units, in whole runs on a virtual clock -------------------------------------------------------


class Typing:
    """A virtual run that ends with two units, and who types serials meanwhile."""

    def __init__(self, duration_s: float, *, refuses_repeats: bool = False) -> None:
        self.run: VirtualRun = prepare(line_text("joints_per_minute = 20"), duration_s=duration_s)
        reading, self.writing = os.pipe()
        clock, utc = self.run.driver.clock, next(iter(self.run.contexts.values())).utc
        source = LineSource(reading, "stdin")
        self.feed = UnitFeed(
            source,
            self.run.memory.event,
            lambda: utc.micros(clock.monotonic()),
            wanted=2,
            refuses_repeats=refuses_repeats,
        )
        self.told = Told()
        self.goals = Goals([Goal("units", 2)], self.told.tell, self._end, self.feed)
        self._look(0.0)

    def _end(self, why: str) -> None:
        self.told.ends.append(why)
        self.run.driver.end(why)

    def _look(self, second: float) -> None:
        def look() -> None:
            self.feed.look()
            self.goals.look()
            self._look(LOOK_EVERY_S)

        self.run.at(second, look)

    def types(self, second: float, line: bytes) -> None:
        self.run.at(second, lambda: os.write(self.writing, line) and None)


@pytest.fixture
def typing(request: pytest.FixtureRequest) -> Iterator[Typing]:
    typing = Typing(request.param)
    yield typing
    os.close(typing.writing)


@pytest.mark.parametrize("typing", [600.0], indirect=True)
@pytest.mark.parametrize("last", [b"SN-3\n", b"END\n"])
def test_a_run_ends_when_its_last_unit_is_finished(typing: Typing, last: bytes) -> None:
    for second, line in ((20.0, b"SN-1\n"), (30.0, b"SN-2\n"), (40.0, last)):
        typing.types(second, line)
    run = typing.run.go()
    typing.feed.finish()
    assert typing.told.kinds == ["run.goal"]
    assert typing.told.ends == ["Units finished: 2, wanted: 2"]
    assert run.facts.outcome == "completed"
    assert run.facts.safe_state == {1: "verified", 2: "verified"}
    # and the time that it takes to make it safe
    assert run.driver.clock.monotonic() - run.t0 == pytest.approx(40.0, abs=3.0)
    assert ("unit.next" in run.memory.kinds()) == (last == b"SN-3\n")
    (goal,) = typing.goals.reached()
    assert (goal.reached, goal.is_met, goal.text) == (2, True, "Units finished: 2, wanted: 2.")


@pytest.mark.parametrize("typing", [60.0], indirect=True)
def test_a_run_that_its_duration_ends_says_how_many_were_missing_and_what_was_on_the_bench(
    typing: Typing,
) -> None:
    for second, line in ((20.0, b"SN-1\n"), (30.0, b"SN-2\n")):
        typing.types(second, line)
    run = typing.run.go()
    typing.feed.finish()
    assert typing.told.ends == []
    (goal,) = typing.goals.reached()
    assert (goal.reached, goal.is_met) == (1, False)
    assert (
        goal.text == "Units finished: 1, wanted: 2. Unit SN-2 was on the bench when the run ended."
    )
    found = findings([run.facts], verdict="ACCEPT", record=None, cut_short=None, goals=[goal])
    assert [(one.code, one.text + ".") for one in found] == [(Exit.NOT_FINE, goal.text)]


@pytest.mark.parametrize(("refuses", "ended_s"), [(False, 40.0), (True, 50.0)])
def test_a_serial_that_comes_back_finishes_the_unit_before_it_only_where_it_is_accepted(
    refuses: bool, ended_s: float
) -> None:
    typing = Typing(600.0, refuses_repeats=refuses)
    try:
        for second, line in (
            (20.0, b"SN-1\n"),
            (30.0, b"SN-2\n"),
            (40.0, b"SN-1\n"),
            (50.0, b"SN-3\n"),
        ):
            typing.types(second, line)
        run = typing.run.go()
    finally:
        os.close(typing.writing)
    assert run.driver.clock.monotonic() - run.t0 == pytest.approx(ended_s, abs=3.0)
    assert typing.feed.finished == {"SN-1", "SN-2"}
    assert [event.severity for event in run.memory.of_kind("unit.repeated")] == [
        Severity.ERROR
    ] * refuses


# -- joints ----------------------------------------------------------------------------------------


class Counting(JointCounting):
    """In the place of the process that counts: at each look the next of `counts`, or the reason why
    there is none.
    """

    def __init__(self, *counts: int | str | None) -> None:
        self.latest, self.why = None, None
        self.counts, self.asked = [*counts], 0

    def __call__(self, _folder: Path) -> Counting:
        return self

    def poll(self) -> bool:
        said = self.counts.pop(0)
        if isinstance(said, str):
            self.why = said
        elif said is not None:
            self.latest = Counted(
                100.0,
                (PortCount("b", 1, None, 1, UNSURE), PortCount("b", 2, said - 1, said - 1, None)),
            )
        return isinstance(said, int)

    def ask(self, *, is_last: bool = False) -> None:
        assert not is_last
        self.asked += 1

    def last(self, most_s: float) -> Counted | None:
        assert most_s == LAST_COUNT_S
        return self.latest if self.poll() else None

    def close(self) -> None: ...


UNSURE = "heat model not plausible"


def counted(
    monkeypatch: pytest.MonkeyPatch, *counts: int | str | None
) -> tuple[Goals, Told, Counting]:
    told, counting = Told(), Counting(*counts)
    goals = Goals([Goal("joints", 5)], told.tell, told.ends.append, None)
    monkeypatch.setattr("jbclog.live.joint_numbers.JointCounting", counting)
    goals.begin(Path())
    return goals, told, counting


def test_a_run_ends_once_when_enough_joints_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    goals, told, _ = counted(monkeypatch, 3, None, 6, 7, 7)
    for _ in range(4):
        goals.look()
    assert told.ends == ["Joints found so far (provisional): 6, wanted: 5"]
    text = f"Joints found: 7, wanted: 5; not known: b port 1 ({UNSURE})."
    assert goals.reached() == [Goal("joints", 5, 7, text)]


def test_a_count_is_asked_for_when_the_missing_joints_can_have_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = {"now": 100.0}
    monkeypatch.setattr(goals_of_a_run.time, "monotonic", lambda: clock["now"])
    goals, _, counting = counted(monkeypatch, 3, *[None] * 5)
    asked = []
    for _ in range(5):
        goals.look()
        asked.append(counting.asked)
        clock["now"] += 0.6
    assert asked == [0, 0, 1, 1, 1]  # once, `LEAST_PAUSE_S` after the count


def test_the_first_count_is_asked_for_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process counts by itself to show numbers, with many ports after minutes."""
    clock = {"now": 100.0}
    monkeypatch.setattr(goals_of_a_run.time, "monotonic", lambda: clock["now"])
    goals, _, counting = counted(monkeypatch, *[None] * 5)
    asked = []
    for _ in range(5):
        goals.look()
        asked.append(counting.asked)
        clock["now"] += 0.6
    assert asked == [0, 0, 1, 1, 1]


def test_what_cannot_be_counted_ends_no_run_and_is_told_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    goals, told, _ = counted(monkeypatch, 3, "no memory")
    for _ in range(4):
        goals.look()
    assert (told.ends, told.kinds) == ([], ["run.uncounted"])
    (goal,) = goals.reached()
    assert goal.reached is None
    assert "is not known" in goal.text


def test_joints_that_cannot_be_counted_at_the_end_are_not_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    goals, _, _ = counted(monkeypatch, "it took too long")
    (goal,) = goals.reached()
    assert (goal.reached, goal.is_met, "it took too long" in goal.text) == (None, False, True)


def test_who_counts_rests_longer_than_it_works_and_while_nothing_can_have_come() -> None:
    assert pause_s(missing=1, ports=2, took_s=0.1) == LEAST_PAUSE_S
    assert pause_s(missing=60, ports=2, took_s=0.1) == 15.0
    assert pause_s(missing=10_000, ports=2, took_s=0.1) == MOST_PAUSE_S
    assert pause_s(missing=1, ports=0, took_s=20.0) == 180.0


# -- what it comes to ------------------------------------------------------------------------------


def test_either_of_two_goals_is_enough() -> None:
    units, joints = Goal("units", 2, 2, "2 units."), Goal("joints", 50, 31, "31 joints.")
    assert findings([], verdict=None, record=None, cut_short=None, goals=[units, joints]) == []
    assert (
        exit_code(findings([], verdict=None, record=None, cut_short=None, goals=[joints]))
        is Exit.NOT_FINE
    )


OF_OMEGA = '\n[line]\nname = "o"\n[[station]]\nname = "o"\nurl = "o"\nfamily = "omega"\n'
OMEGA = '[recipe]\nname = "states"\nrevision = 1\nfamilies = ["omega"]\n[sampling]\nrate_hz = 1\n'


def test_what_can_never_be_reached_is_said_before_a_byte_is_sent(tmp_path: Path) -> None:
    line, recipe = tmp_path / "line.toml", tmp_path / "recipe.toml"
    line.write_text(line_text())
    recipe.write_text(RECIPE)
    with pytest.raises(Problems, match="--until-units 3: serials must be read during the run"):
        make_plan(RunOptions(line, recipe, until_units=3, until_joints=5))
    make_plan(RunOptions(line, recipe, until_units=3, metadata=Metadata(reads_units=True)))
    # a dry run: nobody was asked yet
    make_plan(RunOptions(line, recipe, until_units=3, metadata=None))
    line.write_text(OF_OMEGA)
    recipe.write_text(OMEGA)
    with pytest.raises(Problems, match="--until-joints 5: no station of this run has a tip"):
        make_plan(RunOptions(line, recipe, until_joints=5))
