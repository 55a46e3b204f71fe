"""A run's result: one exit code and the findings behind it (docs/reference/exit-codes.md)."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING, Final

from jbclog.core.states import SafetyResult, StationOutcome
from jbclog.core.text import count_text

if TYPE_CHECKING:  # keeps `--help` fast
    from jbclog.core.goal import Goal
    from jbclog.core.rows import StationFacts


class Exit(IntEnum):
    """Exit codes of the commands (docs/reference/exit-codes.md)."""

    FINE = 0
    NOT_FINE = 1
    USAGE = 2
    STATION = 3
    RECORD = 4
    UNSAFE = 5
    OUTPUT = 6
    INTERRUPTED = 130
    TERMINATED = 143


class Status(StrEnum):
    """How a run ended; values as in the manifest."""

    SUCCESS = "success"
    ABORTED = "aborted"
    FAILED = "failed"
    LOST = "lost"


CUT_SHORT: Final[Mapping[signal.Signals, Exit]] = {
    signal.SIGINT: Exit.INTERRUPTED,
    signal.SIGTERM: Exit.TERMINATED,
    **{number: Exit.TERMINATED for number in signal.Signals if number.name == "SIGHUP"},
}
"""Signals that end a run in good order."""

FINE_VERDICTS = (None, "ACCEPT", "NOT JUDGED")
NEVER_SAMPLED = (
    StationOutcome.LEFT_OUT,
    StationOutcome.NOT_STARTED,
    StationOutcome.REFUSED,
    StationOutcome.GONE,
    StationOutcome.FAILED,
)
SEVEREST_FIRST = (
    Exit.UNSAFE,
    Exit.RECORD,
    Exit.STATION,
    Exit.INTERRUPTED,
    Exit.TERMINATED,
    Exit.OUTPUT,
    Exit.NOT_FINE,
)


@dataclass(frozen=True, slots=True)
class RunFinding:
    """One problem of a run, and the exit code it would cause by itself."""

    code: Exit
    text: str


VERDICT_FINDING: Final = "the verdict is {}"


def findings(
    stations: Iterable[StationFacts],
    *,
    verdict: str | None,
    record: str | None,
    cut_short: Exit | None,
    goals: Sequence[Goal] = (),
) -> list[RunFinding]:
    """Return every problem of a run.

    `record`: what the record lacks. `cut_short`: a signal ended the run early. Meeting one of the
    `goals` is enough.
    """
    found: list[RunFinding] = []
    stations = list(stations)
    for facts in stations:
        found += _of_station(facts)
    if all(facts.outcome in NEVER_SAMPLED for facts in stations):
        found += [
            RunFinding(Exit.STATION, facts.reason)
            for facts in stations
            if facts.outcome == StationOutcome.LEFT_OUT
        ]
    if record:
        found.append(RunFinding(Exit.RECORD, record))
    if cut_short is not None:
        found.append(
            RunFinding(
                cut_short,
                "the run was cut short by a signal before its stated end; the record is closed",
            )
        )
    if not any(goal.is_met for goal in goals):
        found += [RunFinding(Exit.NOT_FINE, goal.text.rstrip(".")) for goal in goals]
    if verdict not in FINE_VERDICTS:
        found.append(RunFinding(Exit.NOT_FINE, VERDICT_FINDING.format(verdict)))
    return found


def _of_station(facts: StationFacts) -> Iterable[RunFinding]:
    for text in facts.unsafe:
        yield RunFinding(Exit.UNSAFE, text)
    if facts.outcome in (StationOutcome.REFUSED, StationOutcome.GONE, StationOutcome.FAILED):
        yield RunFinding(Exit.STATION, facts.reason or f"{facts.name}: {facts.outcome}")
    if facts.outcome == StationOutcome.STOPPED:
        yield RunFinding(Exit.NOT_FINE, facts.reason)
    elif facts.settings_changed:
        yield RunFinding(
            Exit.NOT_FINE,
            f"{facts.name}: {count_text(facts.settings_changed, 'setting')} found changed during"
            " the run",
        )
    if facts.alarms:
        yield RunFinding(Exit.NOT_FINE, f"{facts.name}: {count_text(facts.alarms, 'alarm')}")
    if facts.unconfirmed_alarms:
        yield RunFinding(
            Exit.NOT_FINE,
            f"{facts.name}: {count_text(facts.unconfirmed_alarms, 'alarm flag')} not confirmed by a"
            " temperature",
        )


def in_order(found: Iterable[RunFinding]) -> list[RunFinding]:
    """Sort findings by severity, the most severe first."""
    return sorted(found, key=lambda finding: SEVEREST_FIRST.index(finding.code))


def exit_code(found: Iterable[RunFinding]) -> Exit:
    """Return the most severe code, 0 for no findings."""
    codes = {one.code for one in found}
    return next((code for code in SEVEREST_FIRST if code in codes), Exit.FINE)


def status(found: Iterable[RunFinding]) -> Status:
    """Return the status: aborted by a signal, or failed by a station, a record or a tool."""
    codes = {one.code for one in found}
    if codes & {Exit.UNSAFE, Exit.RECORD, Exit.STATION}:
        return Status.FAILED
    return Status.ABORTED if codes & {Exit.INTERRUPTED, Exit.TERMINATED} else Status.SUCCESS


def tools_text(stations: Iterable[StationFacts]) -> str:
    """Summarize the tools: ``6 tools are in their safe state, as read back``, or the others."""
    states = {
        (facts.name, port): facts.safe_state.get(port)
        for facts in stations
        for port in sorted({*facts.touched, *facts.safe_state})
    }
    unsafe = [
        f"{name} port {port}"
        for (name, port), state in states.items()
        if state != SafetyResult.VERIFIED
    ]
    if unsafe:
        return (
            f"safe state NOT confirmed: {', '.join(unsafe)}; confirmed for"
            f" {len(states) - len(unsafe)} of {count_text(len(states), 'tool')}"
        )
    if not states:
        return "no tool was touched"
    return (
        "1 tool is in its safe state, as read back"
        if len(states) == 1
        else f"{len(states)} tools are in their safe state, as read back"
    )
