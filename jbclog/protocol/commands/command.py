"""One row of a command table.

A code is two letters and the port, one letter with port and tool, or three letters for the whole
station (manual 002, "Commands"); RTT, the transformer, has only two letters
(docs/reference/contradictions.md, B-10). OMEGA's codes are one letter, for some followed by the
number of a solder condition (docs/reference/protocol.md, OMEGA).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

from jbclog.core.quantities import OFF, Quantity, Value, text_of

TOOLS_WITH_A_PLACE = range(1, 10)
"""Tools that a command can address: the code has one character for the number (002, W-Axy)."""


class Scope(Enum):
    """What a command addresses, which determines what follows its letters."""

    STATION = "station"
    PORT = "port"
    TOOL = "tool"
    CONDITION = "condition"


class Effect(Enum):
    """Side effect of a command; decides whether it may be sent twice."""

    NONE = "none"
    CLEARS = "reading clears it"
    MOVES = "moves the machine"
    ERASES = "erases or stores permanently"
    STOPS = "stops the machine"


@dataclass(frozen=True, slots=True)
class Limits:
    """The values that a family's manual prints; others are not sent.

    `printed=False`: the manual prints no range, so the station decides, by N 00003. `off` can be
    printed without a range.
    """

    low: float | None = None
    high: float | None = None
    step: float | None = None
    off: bool = False
    printed: bool = True

    def problem(self, value: Value) -> str | None:
        """Describe why `value` is not allowed; None if it is."""
        if value is OFF:
            return None if self.off else "cannot be switched off"
        if not isinstance(value, int | float):
            return None
        if (self.low is not None and value < self.low) or (
            self.high is not None and value > self.high
        ):
            return f"{value} is outside {self}"
        if self.step and abs(value / self.step - round(value / self.step)) > 1e-6:
            return f"{value} is not a step of {self.step:g}"
        return None

    def __str__(self) -> str:
        if self.low is None and self.high is None:
            text = "range not printed"
        else:
            low = "" if self.low is None else f"{self.low:g}"
            high = "" if self.high is None else f"{self.high:g}"
            text = f"{low}..{high}"
        text += f" step {self.step:g}" if self.step else ""
        return text + (" or off" if self.off else "")


@dataclass(frozen=True, slots=True)
class InferredLimits:
    """Limits that the family's manual does not print, taken from `source`, another manual or
    section.

    A value beyond `limits` is sent: a plan notes it, and the station decides. `unit`: the unit also
    comes from there.
    """

    source: str
    limits: Limits = field(default_factory=Limits)
    unit: bool = False


@dataclass(frozen=True, slots=True)
class Command:
    """A command by its descriptive name, with everything that drivers, pages and people need.

    `limits` are printed for every family with this row, `inferred` ones are not. `within` names the
    commands that read the station's own minimum and maximum; None if it has none. `share_of` reads
    the maximum of a number without a printed unit: recipes and samples state it in per mille of
    that (B-33).
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
    inferred: InferredLimits | None = None

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
    def sent_once(self) -> bool:
        """True if a second copy would have a further effect."""
        return self.effect in (Effect.CLEARS, Effect.MOVES, Effect.ERASES)

    def code(self, port: int | None = None, tool: int | None = None) -> str:
        """Return the code: ``TT1``, ``A12``, ``SMN``."""
        if self.scope is Scope.STATION:
            return self.letters
        if self.scope is Scope.CONDITION:
            raise ValueError(
                f"{self.name} needs the number of a solder condition; use numbered(101)"
            )
        if port is None or not 1 <= port <= 4:
            raise ValueError(f"{self.name} needs a port from 1 to 4, not {port}")
        if self.scope is Scope.PORT:
            return f"{self.letters}{port}"
        if tool is None or tool not in TOOLS_WITH_A_PLACE:
            raise ValueError(f"{self.name} needs a tool from 1 to 9, not {tool}")
        return f"{self.letters}{port}{tool}"

    def numbered(self, condition: int) -> Command:
        """Return the command for one of OMEGA's solder conditions: ``C0065``."""
        if self.scope is not Scope.CONDITION:
            raise ValueError(f"{self.name} has no number behind its letters")
        return replace(self, letters=f"{self.letters}{condition:04X}", scope=Scope.STATION)

    def raw_text(self, data: str, value: Value) -> str:
        """Return the raw characters of `value`: `data` of the last answer if it decodes to `value`,
        else the usual form.
        """
        try:
            return data if self.quantity.decode(data) == value else self.quantity.encode(value)
        except ValueError:
            return self.quantity.encode(value)

    def shown(self, value: Value) -> str:
        """Format the value with its unit, for messages."""
        return f"{text_of(value)} {self.unit}".rstrip() if value is not OFF else "off"
