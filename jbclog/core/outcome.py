"""What a run came to: one exit code and the sentences behind it (docs/reference/exit-codes.md)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum

from jbclog.core.rows import Goal, StationFacts


class Exit(IntEnum):
    """What the shell sees."""

    FINE = 0
    NOT_FINE = 1
    USAGE = 2
    STATION = 3
    RECORD = 4
    UNSAFE = 5
    INTERRUPTED = 130
    TERMINATED = 143


class Status(StrEnum):
    """How a run ended, in the manifest's words."""

    SUCCESS = "success"
    ABORTED = "aborted"
    FAILED = "failed"
    LOST = "lost"


FINE_VERDICTS = (None, "ACCEPT", "NOT JUDGED")
NEVER_BEGUN = ("left_out", "not_started", "refused", "gone", "failed")  # of which none, if alone, makes a run
SEVEREST_FIRST = (Exit.UNSAFE, Exit.RECORD, Exit.STATION, Exit.INTERRUPTED, Exit.TERMINATED, Exit.NOT_FINE)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was not fine, and the exit code that it alone would have."""

    code: Exit
    text: str


def findings(
    stations: Iterable[StationFacts],
    *,
    verdict: str | None,
    record: str | None,
    cut_short: Exit | None,
    goals: Sequence[Goal] = (),
) -> list[Finding]:
    """Everything that was not fine. `record` says what the record lacks; `cut_short` which signal came before a stated end.

    One of the `goals` is enough.
    """
    found: list[Finding] = []
    stations = list(stations)
    for facts in stations:
        found += _of_station(facts)
    if all(facts.outcome in NEVER_BEGUN for facts in stations):
        found += [Finding(Exit.STATION, facts.reason) for facts in stations if facts.outcome == "left_out"]
    if record:
        found.append(Finding(Exit.RECORD, record))
    if cut_short is not None:
        found.append(Finding(cut_short, "the run was cut short by a signal before its stated end; the record is closed"))
    if not any(goal.is_met for goal in goals):
        found += [Finding(Exit.NOT_FINE, goal.text.rstrip(".")) for goal in goals]
    if verdict not in FINE_VERDICTS:
        found.append(Finding(Exit.NOT_FINE, f"the verdict is {verdict}"))
    return found


def _of_station(facts: StationFacts) -> Iterable[Finding]:
    for text in facts.unsafe:
        yield Finding(Exit.UNSAFE, text)
    if facts.outcome in ("refused", "gone", "failed"):
        yield Finding(Exit.STATION, facts.reason or f"{facts.name}: {facts.outcome}")
    if facts.outcome == "stopped":
        yield Finding(Exit.NOT_FINE, facts.reason)
    elif facts.settings_changed:
        yield Finding(Exit.NOT_FINE, f"{facts.name}: {_count(facts.settings_changed, 'setting')} found changed during the run")
    if facts.alarms:
        yield Finding(Exit.NOT_FINE, f"{facts.name}: {_count(facts.alarms, 'alarm')}")
    if facts.unconfirmed_alarms:
        yield Finding(Exit.NOT_FINE, f"{facts.name}: {_count(facts.unconfirmed_alarms, 'alarm')} that no temperature bears out")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def in_order(found: Iterable[Finding]) -> list[Finding]:
    """The findings for people, the most severe first."""
    return sorted(found, key=lambda finding: SEVEREST_FIRST.index(finding.code))


def exit_code(found: Iterable[Finding]) -> Exit:
    """The most severe code among the findings; 0 where there are none."""
    codes = {one.code for one in found}
    return next((code for code in SEVEREST_FIRST if code in codes), Exit.FINE)


def status(found: Iterable[Finding]) -> Status:
    """How the run ended: cut short is aborted; a station, a record or a tool that failed is failed."""
    codes = {one.code for one in found}
    if codes & {Exit.UNSAFE, Exit.RECORD, Exit.STATION}:
        return Status.FAILED
    return Status.ABORTED if codes & {Exit.INTERRUPTED, Exit.TERMINATED} else Status.SUCCESS
