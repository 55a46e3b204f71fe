"""One row of a command table.

A control command is two letters and the port, one letter with port and tool, or three letters for the
whole station (manual 002, "Commands"); RTT, the transformer, has two letters and nothing behind
(docs/reference/contradictions.md, B-10).
OMEGA's commands are one letter, for some with the number of a solder condition behind it
(docs/reference/protocol.md, OMEGA).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

from jbclog.core.quantities import OFF, Quantity, Value, text_of

TOOLS_WITH_A_PLACE = range(1, 10)
"""Tools that a command can speak to: a control command has one character for the number (002, W-Axy)."""


class Scope(Enum):
    """What a command speaks to, and so what stands behind its letters."""

    STATION = "station"
    PORT = "port"
    TOOL = "tool"
    CONDITION = "condition"


class Effect(Enum):
    """What sending it does besides carrying a value; decides whether it may be sent twice."""

    NONE = "none"
    CLEARS = "reading clears it"
    MOVES = "moves the machine"
    ERASES = "erases or stores for good"
    STOPS = "stops the machine"


@dataclass(frozen=True, slots=True)
class Limits:
    """The values that the manual of a family prints: beyond them nothing is sent.

    `printed=False` marks a range that this manual does not give: the station decides, with N 00003. `off` can be printed without
    one.
    """

    low: float | None = None
    high: float | None = None
    step: float | None = None
    off: bool = False
    printed: bool = True

    def problem(self, value: Value) -> str | None:
        """Why `value` is not allowed, or None."""
        if value is OFF:
            return None if self.off else "cannot be switched off"
        if not isinstance(value, int | float):
            return None
        if (self.low is not None and value < self.low) or (self.high is not None and value > self.high):
            return f"{value} is outside {self}"
        if self.step and abs(value / self.step - round(value / self.step)) > 1e-6:
            return f"{value} is not a step of {self.step:g}"
        return None

    def __str__(self) -> str:
        if self.low is None and self.high is None:
            text = "range not printed"
        else:
            text = f"{'' if self.low is None else f'{self.low:g}'}..{'' if self.high is None else f'{self.high:g}'}"
        text += f" step {self.step:g}" if self.step else ""
        return text + (" or off" if self.off else "")


@dataclass(frozen=True, slots=True)
class Inferred:
    """What the manual of a family does not print of a command, taken from `source`, another manual or section.

    A value beyond `limits` is sent: a plan notes it, and the station decides. `unit`: the unit is taken from there, too.
    """

    source: str
    limits: Limits = field(default_factory=Limits)
    unit: bool = False


@dataclass(frozen=True, slots=True)
class Command:
    """A command by its trade name, with everything that a driver, a page or a person needs of it.

    `limits` are printed for every family that has this row, `inferred` are not. `within` are the commands that tell the lowest
    and the highest value that the station itself allows; None where it sets no such end. `share_of` is the one
    that tells what a number without a printed unit is a share of: recipes and samples hold it in per mille of that (B-33).
    """

    name: str
    letters: str
    scope: Scope
    quantity: Quantity
    access: str  # "r", "w" or "rw"
    manual: str
    limits: Limits = field(default_factory=Limits)
    effect: Effect = Effect.NONE
    dangerous: bool = False
    answer_digits: int | None = 5  # None: any length
    note: str = ""
    within: tuple[str | None, str] | None = None
    share_of: str | None = None
    inferred: Inferred | None = None

    @property
    def readable(self) -> bool:
        return "r" in self.access

    @property
    def writable(self) -> bool:
        return "w" in self.access

    @property
    def unit(self) -> str:
        return self.quantity.unit

    @property
    def asked_once(self) -> bool:
        """Whether a second sending would do something a second time."""
        return self.effect in (Effect.CLEARS, Effect.MOVES, Effect.ERASES)

    def code(self, port: int | None = None, tool: int | None = None) -> str:
        """The control command on the wire: ``TT1``, ``A12``, ``SMN``."""
        if self.scope is Scope.STATION:
            return self.letters
        if self.scope is Scope.CONDITION:
            raise ValueError(f"{self.name} needs the number of a solder condition; ask for numbered(101)")
        if port is None or not 1 <= port <= 4:
            raise ValueError(f"{self.name} needs a port from 1 to 4, not {port}")
        if self.scope is Scope.PORT:
            return f"{self.letters}{port}"
        if tool is None or tool not in TOOLS_WITH_A_PLACE:
            raise ValueError(f"{self.name} needs a tool from 1 to 9, not {tool}")
        return f"{self.letters}{port}{tool}"

    def numbered(self, condition: int) -> Command:
        """The command for one of OMEGA's solder conditions, which speaks to the station like any other: ``C0065``."""
        if self.scope is not Scope.CONDITION:
            raise ValueError(f"{self.name} has no number behind its letters")
        return replace(self, letters=f"{self.letters}{condition:04X}", scope=Scope.STATION)

    def as_it_came(self, data: str, value: Value) -> str:
        """The characters by which `value` was told: `data`, those of the last answer, where they say it, else its usual form."""
        try:
            return data if self.quantity.decode(data) == value else self.quantity.encode(value)
        except ValueError:
            return self.quantity.encode(value)

    def shown(self, value: Value) -> str:
        """The value as text with its unit, for sentences."""
        return f"{text_of(value)} {self.unit}".rstrip() if value is not OFF else "off"
