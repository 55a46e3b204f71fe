"""Every error that jbclog raises, and the exit code that a run comes to.

::

    JbclogError
    ├── UsageError                  exit 2: a wrong file, name or option; nothing was sent
    │   └── Problems                several of them, each with file, line and key
    ├── LinkError (OSError)         the cable, the port or the server is gone
    │   ├── PortBusy                somebody else holds the port
    │   ├── PortForbidden           this user may not open it
    │   ├── PortMissing             there is no such port
    │   ├── LinkFlooded             far more bytes come over it than answers are due
    │   └── OtherStation            what answers is not the station that the run began with
    ├── StationError                the link works, the station did not give what was asked
    │   ├── AnswerTimeout (TimeoutError)
    │   │   └── StationSilent       nothing answers any more, probes included
    │   ├── AnswerCorrupt           an answer came, its check byte was wrong
    │   ├── AnswerFormat            an answer came that no answer to this question can be
    │   ├── ImplausibleAnswer       well-formed, and not believable
    │   └── Refusal                 the station said N
    │       ├── NotReceived         1, 2: it did not understand the frame
    │       ├── OutOfRange          3
    │       ├── NotSupported        4: it does not know the command
    │       │   └── Ignored         OMEGA: it says nothing to what it refuses, and answered what was asked next
    │       ├── RobotModeOff        5: nobody switched Robot mode on
    │       └── ModelUnknown        6
    ├── StartRefused                exit 3: the station, the recipe or the rate does not fit
    ├── WriteForbidden              something was to be written that nobody asked for; it was not sent
    ├── RecordError                 exit 4: the record could not be kept whole
    └── Unsafe                      exit 5: a tool could not be put in its safe state

Alarms and faults *of a station* are not here: they are rows in `events`. An exception is for what the
program cannot do.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the guard loads no rows
    from jbclog.core.rows import Goal, StationFacts

# -- errors -------------------------------------------------------------------------------------------------------------------


class JbclogError(Exception):
    """The root. `exit_code` is what a command ends with when nothing catches it (docs/reference/exit-codes.md)."""

    exit_code = 1


class UsageError(JbclogError):
    """A wrong file, name or option. Nothing was sent to any station."""

    exit_code = 2


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing wrong in a file: where it stands, what is wrong, what to do."""

    file: str
    line: int | None
    key: str
    text: str

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}" if self.line else self.file
        return f"{where}: {self.key}: {self.text}" if self.key else f"{where}: {self.text}"


class Problems(UsageError):
    """All problems of the files given, at once."""

    def __init__(self, problems: list[Problem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = problems


class LinkError(JbclogError, OSError):
    """The port is gone: every kind of exception that pyserial throws at a pulled cable becomes this one."""

    exit_code = 3
    reason = "disconnected"


class PortBusy(LinkError):
    """Another program holds the port. `process` is its number, where that can be found out."""

    def __init__(self, text: str, process: int | None = None) -> None:
        super().__init__(text)
        self.process = process


class PortForbidden(LinkError):
    """The system does not let this user open the port."""


class PortMissing(LinkError):
    """There is no port of that name: unplugged, or named otherwise."""


class LinkFlooded(LinkError):
    """At least `came` bytes came over the link in `seconds`, where answers of `due` bytes were due and `limit` is the most.

    More may have been sent: a port that brings too much is not read without pause.
    """

    def __init__(self, came: int, due: int, seconds: float, limit: int) -> None:
        text = f"the link is flooded: at least {came} bytes came in {seconds:.1f} s, "
        text += f"answers of {due} bytes were due (limit: {limit} bytes)"
        super().__init__(f"{text}; find what sends on it")
        self.came = came
        self.seconds = seconds
        self.limit = limit


class OtherStation(LinkError):
    """What answers is, by what it says of itself, not the station that the run began with, or not since `since` (monotonic)."""

    def __init__(self, text: str, since: float) -> None:
        super().__init__(text)
        self.since = since


class StationError(JbclogError):
    """One question got no usable answer. `reason` is the word that stands in the record."""

    exit_code = 3
    reason = "format"


class AnswerTimeout(StationError, TimeoutError):
    """No answer within the time that bytes and turnaround need."""

    reason = "timeout"


class StationSilent(AnswerTimeout):
    """Nothing answers any more: neither the question nor the probes after it."""


class AnswerCorrupt(StationError):
    """An answer whose check byte does not match."""

    reason = "bcc"


class AnswerFormat(StationError):
    """A whole frame that cannot be the answer: other code, address, length or digits."""

    reason = "format"


class ImplausibleAnswer(StationError):
    """A well-formed answer whose value cannot be true."""

    reason = "implausible"


class Refusal(StationError):
    """The station answered N. `code` is its communication error (manual 002, "Communication Errors")."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code

    @property
    def reason(self) -> str:  # type: ignore[override]  # the code belongs into the word
        return f"nak{self.code}"


class NotReceived(Refusal):
    """N 1 or 2: the station found a wrong check byte or format. A read may be sent again."""


class OutOfRange(Refusal):
    """N 3: the value is outside the station's limits."""


class NotSupported(Refusal):
    """N 4: the station does not accept this command."""


class Ignored(NotSupported):
    """OMEGA's way to refuse: no answer, while the next question was answered. Nothing tells why (manual 003, 11.2)."""

    reason = "timeout"  # in the record it is what it looks like

    def __init__(self, text: str) -> None:
        super().__init__(0, text)


class RobotModeOff(Refusal):
    """N 5: Robot mode is off in the station's menu."""

    @property
    def reason(self) -> str:  # type: ignore[override]
        return "robot_off"


class ModelUnknown(Refusal):
    """N 6: the station does not know its own model."""


class StartRefused(JbclogError):
    """A station's run cannot begin: wrong identity, recipe refused, rate does not fit."""

    exit_code = 3


class WriteForbidden(JbclogError):
    """What is no question, over a port that is open for reading only; or what is not on a run's list. A fault of this program."""


class RecordError(JbclogError):
    """The record is, or would become, incomplete."""

    exit_code = 4


class Unsafe(JbclogError):
    """A tool that the run touched could not be put in its safe state."""

    exit_code = 5


def cause(error: BaseException) -> str:
    """What `error` says, or what it means where it says nothing, as `MemoryError` does."""
    return str(error) or ("memory was refused" if isinstance(error, MemoryError) else "it gives no reason")


def of_program(error: BaseException) -> str:
    """``MemoryError: memory was refused``: an error that no rule of this program expects, with its cause in words."""
    return f"{type(error).__name__}: {cause(error)}"


# -- outcome ------------------------------------------------------------------------------------------------------------------
# The result of a run: one exit code and the sentences behind it (docs/reference/exit-codes.md).


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
VERIFIED = "verified"  # a tool that was read back in its safe state


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


def tools_text(stations: Iterable[StationFacts]) -> str:
    """How the tools were left: ``6 tools are in their safe state, as read back``, or which are not."""
    states = {(facts.name, port): facts.safe_state.get(port) for facts in stations for port in _touched(facts)}
    unsafe = [f"{name} port {port}" for (name, port), state in states.items() if state != VERIFIED]
    if unsafe:
        return f"NOT known to be in their safe state: {', '.join(unsafe)}; {len(states) - len(unsafe)} of {len(states)} tools are"
    if not states:
        return "no tool was touched"
    return (
        "1 tool is in its safe state, as read back"
        if len(states) == 1
        else f"{len(states)} tools are in their safe state, as read back"
    )


def _touched(facts: StationFacts) -> list[int]:
    return sorted({*facts.touched, *facts.safe_state})
