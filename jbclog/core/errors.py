"""The errors that jbclog raises.

::

    JbclogError
    ├── UsageError                  exit 2: wrong file, name or option; nothing was sent
    │   └── Problems                several of them, each with file, line and key
    ├── LinkError (OSError)         the cable, port or server is gone
    │   ├── PortBusy                another process holds the port
    │   ├── PortForbidden           this user may not open the port
    │   ├── PortMissing             there is no such port
    │   ├── LinkFlooded             far more bytes arrive than answers are due
    │   └── OtherStation            the station differs from the one that the run started with
    ├── StationError                the link works, one request got no usable answer
    │   ├── AnswerTimeout (TimeoutError)
    │   │   └── StationSilent       no answer any more, to probes neither
    │   ├── AnswerCorrupt           wrong check byte
    │   ├── AnswerFormat            a frame that cannot answer this request
    │   ├── ImplausibleAnswer       well-formed, value not credible
    │   ├── AnswerContradicted      two different answers to one request
    │   └── Refusal                 the station answered N
    │       ├── NotReceived         1, 2: frame not understood
    │       ├── OutOfRange          3
    │       ├── NotSupported        4: unknown command
    │       │   └── Ignored         OMEGA: no answer to this request, an answer to the next
    │       ├── RobotModeOff        5
    │       └── ModelUnknown        6
    ├── StartRefused                exit 3: the station, the recipe or the rate does not fit
    ├── WriteForbidden              a write that the run does not allow; it was not sent
    ├── RecordError                 exit 4: the record is, or would become, incomplete
    └── Unsafe                      exit 5: a tool is not in its safe state

Alarms and faults *of a station* are rows in `events`, not errors.
"""

from __future__ import annotations

from dataclasses import dataclass

from jbclog.core.text import clean


class JbclogError(Exception):
    """Base class. `exit_code` is that of a command that ends by this error
    (docs/reference/exit-codes.md).

    Its text is one clean line: it may repeat names of others, and Python prints it as it is, in
    tracebacks and notebooks.
    """

    exit_code = 1

    def __str__(self) -> str:
        return clean(super().__str__())


class UsageError(JbclogError):
    """A wrong file, name or option. Nothing was sent to a station."""

    exit_code = 2


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake in a file: where, what, and how to fix it."""

    file: str
    line: int | None
    key: str
    text: str

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}" if self.line else self.file
        return f"{where}: {self.key}: {self.text}" if self.key else f"{where}: {self.text}"


class Problems(UsageError):
    """All problems of the given files; its text has a line for each."""

    def __init__(self, problems: list[Problem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = problems

    def __str__(self) -> str:
        return "\n".join(clean(str(problem)) for problem in self.problems)


def problems_of(error: UsageError) -> list[Problem]:
    """Return the mistakes that an error reports; its text is the one mistake if it is no list."""
    if isinstance(error, Problems):
        return error.problems
    where, separator, text = str(error).partition(": ")
    if not separator:
        return [Problem("command line", None, "", where)]
    return [Problem(where, None, "", text)]


class LinkError(JbclogError, OSError):
    """The port is gone: covers every exception that pyserial raises for a lost cable."""

    exit_code = 3
    reason = "disconnected"


class PortBusy(LinkError):
    """Another process holds the port; `process` is its id, if known."""

    def __init__(self, text: str, process: int | None = None) -> None:
        super().__init__(text)
        self.process = process


class PortForbidden(LinkError):
    """The system does not allow this user to open the port."""


class PortMissing(LinkError):
    """No port has that name: unplugged or renamed."""


class LinkFlooded(LinkError):
    """At least `came` bytes arrived within `seconds`; answers of `due` bytes were due, and `limit`
    is the maximum.

    The true number may be higher: the driver pauses between reads of a flooded port.
    """

    def __init__(self, came: int, due: int, seconds: float, limit: int) -> None:
        text = f"the link is flooded: at least {came} bytes came in {seconds:.1f} s, "
        text += f"answers of {due} bytes were due (limit: {limit} bytes)"
        super().__init__(f"{text}; find what sends on it")
        self.came = came
        self.seconds = seconds
        self.limit = limit


class OtherStation(LinkError):
    """The station's identity no longer matches the one at the start of the run; it changed at
    `since` (monotonic) or earlier.
    """

    def __init__(self, text: str, since: float) -> None:
        super().__init__(text)
        self.since = since


class StationError(JbclogError):
    """One request got no usable answer. The record shows `reason`."""

    exit_code = 3
    reason = "format"


class AnswerTimeout(StationError, TimeoutError):
    """No answer within transmission time plus response time."""

    reason = "timeout"


class StationSilent(AnswerTimeout):
    """No answer to the request, nor to the probes after it."""


class AnswerCorrupt(StationError):
    """An answer whose check byte does not match."""

    reason = "bcc"


class AnswerFormat(StationError):
    """A complete frame that cannot be the answer: wrong code, address, length or digits."""

    reason = "format"


class ImplausibleAnswer(StationError):
    """A well-formed answer with an impossible value."""

    reason = "implausible"


class AnswerContradicted(StationError):
    """Two different answers to one request came together; one of them is another request's."""

    reason = "contradicted"


class Refusal(StationError):
    """The station answered N with the communication error `code` (manual 002, "Communication
    Errors").
    """

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code

    @property
    def reason(self) -> str:  # type: ignore[override]  # it contains the code
        return f"nak{self.code}"


class NotReceived(Refusal):
    """N 1 or 2: the station found a wrong check byte or format. A read may be sent again."""


class OutOfRange(Refusal):
    """N 3: the value is outside the station's limits."""


class NotSupported(Refusal):
    """N 4: the station does not accept this command."""


class Ignored(NotSupported):
    """OMEGA's refusal: no answer to this request, but one to the next; the station gives no reason
    (manual 003, 11.2).
    """

    reason = "timeout"  # as the record shows it

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
    """A station's run cannot start: wrong identity, refused recipe, or a rate that does not fit."""

    exit_code = 3


class WriteForbidden(JbclogError):
    """A write to a port opened for reading only, or one that the run does not list. A bug in
    jbclog.
    """


class RecordError(JbclogError):
    """The record is, or would become, incomplete."""

    exit_code = 4


class Unsafe(JbclogError):
    """A tool that the run touched is not in its safe state."""

    exit_code = 5


# messages of the dynamic loader when it is out of memory
NOT_LOADED = ("failed to map segment", "cannot allocate memory", "Cannot allocate memory")


def cause(error: BaseException) -> str:
    """Return the text of `error`, or a description if it has none, as with `MemoryError`.

    Loading a library without enough memory raises `ImportError`; some packages then report
    themselves as incomplete.
    """
    if isinstance(error, ImportError) and any(text in str(error) for text in NOT_LOADED):
        return f"memory was refused: {error}"
    return str(error) or (
        "memory was refused" if isinstance(error, MemoryError) else "it gives no reason"
    )


def unexpected_error_text(error: BaseException) -> str:
    """Format an unexpected error with its type: ``MemoryError: memory was refused``."""
    return f"{type(error).__name__}: {cause(error)}"
