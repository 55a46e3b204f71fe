"""What a guard makes of the outcome of each station: what stays leased, what it writes down, what
it opens.
"""

from __future__ import annotations

import resource
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from support.faults.guarded import actions_in
from support.product import (
    BESIDE,
    EXTRACTOR,
    OPENING,
    STAND,
    ActionLog,
    LinkFlooded,
    SafetyResult,
    SafetyTask,
    StationLease,
    TakeOver,
    patch,
)

LEASE = StationLease(
    "dde-1", "/dev/no1", 19200, "8N1", 1, "dde", "DDE", "1.0", "stand", (1, 2), False
)


@pytest.fixture
def becomes(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[SafetyTask], None]], None]:
    """What is made of the task, in place of talking to a station."""

    def make(outcome: Callable[[SafetyTask], None]) -> None:
        patch(monkeypatch, "takeover.secure", lambda task: task)
        patch(monkeypatch, "takeover.blocking.run", lambda task, *_, **__: outcome(task))

    return make


def test_there_are_descriptors_for_all_ports_that_are_opened_at_once(tmp_path: Path) -> None:
    nobodys = [
        replace(LEASE, name=f"s{number}", family="of a later version") for number in range(40)
    ]
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (BESIDE + 40, hard))
    try:
        assert TakeOver(nobodys, ActionLog(tmp_path)).run() == nobodys
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] >= BESIDE + 40 * OPENING
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def spared(task: SafetyTask) -> None:
    for tool in task.tools:
        tool.reached, tool.status, tool.was_spared = SafetyResult.VERIFIED, STAND, True


def put(task: SafetyTask) -> None:
    for tool in task.tools:
        tool.note_order(STAND)
        tool.reached, tool.status = SafetyResult.VERIFIED, STAND


def fallen_back(task: SafetyTask) -> None:
    for tool in task.tools:
        tool.note_order(EXTRACTOR)
        tool.pass_over(EXTRACTOR, "extractor was refused")
        tool.note_order(STAND)
        tool.reached, tool.status = SafetyResult.VERIFIED, STAND


def sent(task: SafetyTask) -> None:
    for tool in task.tools:
        tool.note_order(STAND)
        tool.reached = SafetyResult.SENT


def flooded(task: SafetyTask) -> None:
    sent(task)
    task.flood = LinkFlooded(9000, 40, 1.0, 4096)


def flooded_later(task: SafetyTask) -> None:
    flooded(task)
    task.tools[0].reached, task.tools[0].status = SafetyResult.VERIFIED, STAND


def one_failed(task: SafetyTask) -> None:
    put(task)
    task.tools[1].reached, task.tools[1].status = SafetyResult.FAILED, None


def feeding(task: SafetyTask) -> None:
    put(task)
    task.feeds = True


PUT = (
    "safety.safe_state",
    "info",
    "The tool was put in its safe state by the guard, as read back: stand.",
)
FELL_BACK = (
    "warning",
    "The tool was put in its safe state by the guard, as read back: stand; extractor was refused.",
)
HOT = "it may be hot: switch the station off."
UNCONFIRMED = "The tool was ordered into its safe state by the guard and does not confirm it"
NOT_SAFE = ("safety.not_safe", "critical")


@pytest.mark.parametrize(
    ("outcome", "lines", "left"),
    [
        (
            spared,
            [
                (
                    "safety.safe_state",
                    "info",
                    "The tool was in its safe state already, as read back: stand.",
                )
            ]
            * 2,
            None,
        ),
        (put, [PUT] * 2, None),
        (fallen_back, [("safety.safe_state", *FELL_BACK)] * 2, None),
        (sent, [(*NOT_SAFE, f"{UNCONFIRMED}; {HOT}")] * 2, ((1, 2), False)),
        (
            flooded,
            [(*NOT_SAFE, f"{UNCONFIRMED} (its link is flooded); {HOT}")] * 2,
            ((1, 2), False),
        ),
        (
            flooded_later,
            [PUT, (*NOT_SAFE, f"{UNCONFIRMED} (its link is flooded); {HOT}")],
            ((2,), False),
        ),
        (one_failed, [PUT, (*NOT_SAFE, f"The tool could not be made safe; {HOT}")], ((2,), False)),
        (
            feeding,
            [PUT, PUT, (*NOT_SAFE, "The guard could not stop the feeder; switch the station off.")],
            ((), True),
        ),
    ],
)
@pytest.mark.parametrize("again", [False, True])
def test_each_tool_is_in_the_diary_once_and_what_is_not_safe_stays_leased(
    outcome: Callable[[SafetyTask], None],
    lines: list[tuple[str, str, str]],
    left: tuple[tuple[int, ...], bool] | None,
    again: bool,
    becomes: Callable[[Callable[[SafetyTask], None]], None],
    tmp_path: Path,
    said: list[str],
) -> None:
    becomes(outcome)
    taking_over = TakeOver(
        [replace(LEASE, feeds=outcome is feeding)], ActionLog(tmp_path), again=again
    )
    remaining = taking_over.run()
    assert [(one.ports, one.feeds) for one in remaining] == ([] if left is None else [left])
    ports = (1, 2, None)
    expected = [
        (kind, severity, port, text)
        for (kind, severity, text), port in zip(lines, ports, strict=False)
        if not (again and severity == "critical")  # that was said the first time
    ]
    assert actions_in(tmp_path) == expected
    places = ["dde-1" if port is None else f"dde-1 port {port}" for _, _, port, _ in expected]
    assert [f"{line}." for line in said] == [
        f"{place}: {text[0].lower()}{text[1:]}"
        for place, (*_, text) in zip(places, expected, strict=True)
    ]
    assert taking_over.flooded == ({LEASE.name} if outcome is flooded else set())


@pytest.mark.parametrize(("faults", "left"), [(1, []), (2, [LEASE])])
def test_a_fault_of_a_moment_is_tried_again_and_one_that_stays_is_written_down(
    faults: int,
    left: list[StationLease],
    becomes: Callable[[Callable[[SafetyTask], None]], None],
    tmp_path: Path,
) -> None:
    tried: list[SafetyTask] = []

    def fails(task: SafetyTask) -> None:
        tried.append(task)
        if len(tried) <= faults:
            raise MemoryError("no memory")
        put(task)

    becomes(fails)
    assert TakeOver([LEASE], ActionLog(tmp_path)).run() == left
    lines = [line[:2] + line[3:] for line in actions_in(tmp_path)]
    assert lines == (
        [("guard.failed", "critical", f"The guard failed, MemoryError: no memory; {HOT}")]
        if left
        else [PUT] * 2
    )
