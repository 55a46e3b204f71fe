"""A second look at what is hard to believe: asked again before it is taken, and marked.

One flipped pair of bits in sixteen passes the check byte (docs/reference/faults.md, F-3). So what would stop a run, what is a
counter, and what no tool can do is believed when another answer says the same. A jump of temperature that was believed
so, and every answer that the next one did not bear out, is counted in the facts (`doubted`) and told once a series.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from jbclog.core.errors import ImplausibleAnswer
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.client.agreement import borne_out
from jbclog.protocol.client.interface import Asking
from jbclog.protocol.commands.possible import STILL_C, TEMPERATURES, Possible
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.scheduler import Reading

LOOKS = 3  # answers that are asked for at the most
JUMP_EVERY_S = 0.25  # a family's `jump_c` in this time is twice what its quickest tools make while they heat up
SERIES_S = 60.0  # what is doubted again within this time is not told again

Doubt = Callable[[SessionContext, PortState, Value], bool]


@dataclass(slots=True)
class SecondLook:
    """The doubts about one reading of one port."""

    reading: Reading
    port: PortState
    question: Asking
    doubt: Doubt | None
    possible: Possible | None = None
    heard_at: float | None = None  # of the last answer that was believed
    told_at: float | None = None  # of the last one that was doubted

    def is_due(self, context: SessionContext, value: Value) -> bool:
        """Whether `value` is hard to believe."""
        doubtful = self.doubt is not None and self.doubt(context, self.port, value)
        if not (doubtful or self._is_impossible(value)):
            return False
        return context.family.void(self.reading.name, self.port.tool, self.port.error) is None  # it means nothing anyhow

    def _is_impossible(self, value: Value) -> bool:
        return self.possible is not None and not self.possible(value)

    def settle(self, context: SessionContext, first: Value) -> Steps[Value]:
        """Ask again until an answer leaves no doubt or is borne out by another.

        Raises `ImplausibleAnswer` where none does, and what asking raises.
        """
        given = [first]
        while len(given) < LOOKS:
            given.append((yield from context.station.ask(self.question)))
            value = self._settled(context, given)
            if value is not None:
                return value
            if given[-1] == given[-2]:
                break  # said twice, and it cannot be true
        context.doubted[self.reading.command.name] += 1
        raise ImplausibleAnswer(f"{self.question.title()}: {self._shown(given)} when asked {len(given)} times")

    def _settled(self, context: SessionContext, given: Sequence[Value]) -> Value | None:
        """What the last answer settles. Marked where it contradicts another, or is a jump that no tool makes."""
        value: Value | None = given[-1]
        if not self.is_due(context, given[-1]):
            contradicts = not self._is_near(given)
        else:
            value, contradicts = self._borne_out(context, given), len(given) > 2 and not self._grows
        if value is not None and (contradicts or self._is_jump(context, value)):
            self._mark(context, given, value, is_jump=not contradicts)
        return value

    @property
    def _is_temperature(self) -> bool:
        return self.reading.name in TEMPERATURES

    @property
    def _last_c(self) -> int | None:
        """The temperature that was last believed."""
        return self.port.temperatures_c.get(self.reading.name)

    @property
    def _grows(self) -> bool:
        return self.reading.counter is not None

    def _borne_out(self, context: SessionContext, given: Sequence[Value]) -> Value | None:
        """What two of the answers say, if it can be. A temperature may have moved a little between them."""
        if self._is_impossible(given[-1]):
            return None
        if not self._is_temperature:
            return borne_out(given, grows=self._grows)
        return given[-1] if self._is_near(given) else None

    def _is_near(self, given: Sequence[Value]) -> bool:
        """Whether the last is a temperature about as high as another of the answers."""
        *before, last = given
        if not self._is_temperature or not isinstance(last, int):
            return False
        return any(isinstance(one, int) and abs(last - one) <= STILL_C for one in before)

    def _is_jump(self, context: SessionContext, value: Value) -> bool:
        """Whether no tool gets from the last temperature to this one in the time that was between them."""
        known = self._last_c
        if not isinstance(value, int) or known is None or self.heard_at is None:
            return False
        spans = max((context.station.heard - self.heard_at) / JUMP_EVERY_S, 1.0)
        return abs(value - known) > context.family.jump_c * spans

    def _mark(self, context: SessionContext, given: Sequence[Value], value: Value, *, is_jump: bool) -> None:
        context.doubted[self.reading.command.name] += 1
        is_new = self.told_at is None or context.now - self.told_at > SERIES_S
        self.told_at = context.now
        if not is_new:
            return
        if is_jump:
            text = f"The {self.question.title()} jumped from {self._last_c} °C to {value} °C; a second answer bore it out."
        else:
            text = f"The {self.question.title()} was {self._shown(given)} when asked {len(given)} times; the last is believed."
        number = float(value) if isinstance(value, int | float) else None
        raw = self.reading.command.shown(given[0])
        context.note("read.doubted", Severity.INFO, text, port=self.port.number, since=self.heard_at, value=number, raw=raw)

    def _shown(self, given: Sequence[Value]) -> str:
        return " and ".join(map(self.reading.command.shown, given))
