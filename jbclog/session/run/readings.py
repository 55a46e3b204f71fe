"""Decide whether an answer is recorded: which values have no meaning, and which are read again
before they are accepted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp

from jbclog.core.errors import ImplausibleAnswer
from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.client.confirmed_reads import confirmed_value
from jbclog.protocol.client.interface import PreparedRead
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import OMEGA, Family
from jbclog.protocol.commands.omega import WITHOUT_DIGIT
from jbclog.protocol.commands.ranges import (
    NO_COUNTDOWN,
    STILL_C,
    TEMPERATURES,
    Possible,
    is_share,
    plausibility_check,
)
from jbclog.session.rates import IDENTITY_READS, WATCHED_SETTINGS
from jbclog.session.run.alarms import bears_out
from jbclog.session.run.context import SessionContext
from jbclog.session.run.omega_states import differs_from_last
from jbclog.session.run.state import PortState, StationState
from jbclog.session.run.watch import arrives
from jbclog.session.scheduler import ScheduledRead

NOT_COUNTING = "not_counting"
NO_MAXIMUM = "no_maximum"
NO_DIGIT = "no_digit"


def may_be_unusable(reading: ScheduledRead, family: Family) -> bool:
    """Return True if `unusable` can ever return a reason for an answer to `reading`."""
    has_own_reason = (
        reading.name == "delay_s"
        or reading.command.share_of is not None
        or family.protocol == OMEGA
    )
    return has_own_reason or any(
        signal == reading.name for _, signal, _ in family.port_errors.voids
    )


def unusable(
    reading: ScheduledRead, value: Value, port: PortState, state: StationState
) -> str | None:
    """Return why a well-formed value is not recorded; None if it is.

    A countdown that does not run has no remaining time, a share of an unknown maximum is unknown,
    and an answer without its digit has no state.
    """
    if reading.name == "delay_s":
        # a tool that stands may be counting down to sleep or hibernation
        stands = port.status is not None and port.status[4] in (1, 2)
        if value in NO_COUNTDOWN or (value == 0 and not stands):
            return NOT_COUNTING
    if value == WITHOUT_DIGIT:
        return NO_DIGIT
    if reading.command.share_of is not None and state.whole_of(reading.command) is None:
        return NO_MAXIMUM
    return void(reading.name, port, state)


def void(signal: str, port: PortState, state: StationState) -> str | None:
    """Return why answers have no meaning during the port's error; None if they have one
    (docs/reference/contradictions.md, B-44).
    """
    return state.family.port_errors.void(port.error, signal)


# Plausibility: `protocol/commands/ranges.py` by family, here by station. Anything else is not a
# value, however often it is repeated, but is read again before that is decided.


def possible_of(state: StationState, reading: ScheduledRead) -> Possible | None:
    """Return a check whether an answer to `reading` is plausible; None if every answer is."""
    possible = plausibility_check(reading.name, state.family)
    if possible is None and reading.command.share_of is not None:
        return _share_of(reading.command, state)
    return possible


def _share_of(command: Command, state: StationState) -> Possible:
    """Return a check that a share is not much more than the whole, once that is known."""

    def possible(value: Value) -> bool:
        whole = state.whole_of(command)
        return whole is None or is_share(value, whole)

    return possible


# While a tool is pulled out of its port, the station continues for some readings with 0 °C, 0 ‰ and
# status working, before its port error says so. The temperature is no tip's: no tip cools that
# fast. The limit is that of a tip that loses its heat to surroundings of `COLDEST_C` with a time
# constant of `FASTEST_S`, for the time since the last reading and `SHOWN_S` more.
#
# Why it is far from anything that soldering does: heat leaves a tip through its contact. A small
# cartridge has some 0.2 J/K and loses at most 0.1 W/K to a joint, a large one 3 J/K and 1 W/K, so
# the time constant is seconds. Boiling water takes at most 1 W/mm², which is below 150 °C/s for any
# of them. On three simulated stations of independent make, the worst of wet sponges, brass wool,
# shield cans and busbars takes 33 °C in 0.2 s and 95 °C in 1 s, a time constant of 2 s; a reading
# of a tip at 350 °C is refused here below 62 °C after 0.2 s, and below 8 °C after 1 s.

PULLED = "pulled"
COLDEST_C = 5.0  # no bench is colder, so no tip ever gets there
FASTEST_S = 0.25
SHOWN_S = 0.25  # readings may be of the station's last measurement, and its sensor lags
LEAST_FALL_C = 15  # smaller falls are never refused


def fell_too_fast(port: PortState, value: Value, at: float) -> bool:
    """Return True if no tip can have cooled from the last accepted temperature to `value`, read at
    `at` (monotonic seconds).
    """
    before, since = port.temperature_c, port.temperature_at
    if before is None or since is None or not isinstance(value, int):
        return False
    if before - value <= LEAST_FALL_C:
        return False
    left = exp(-(max(at - since, 0.0) + SHOWN_S) / FASTEST_S)
    return value < COLDEST_C + (before - COLDEST_C) * left


# One in sixteen double bit errors passes the check byte (docs/reference/faults.md, F-3). So a value
# that would stop a run, a counter, and an implausible value need a second, equal answer. A jump of
# temperature accepted this way, and every answer that the next one does not confirm, is counted in
# the facts (`doubted`) and reported once for a series.

LOOKS = 3  # answers, at most
# in this time the fastest tools change by half of a family's `jump_c` while heating up
JUMP_EVERY_S = 0.25
SERIES_S = 60.0  # within this time another doubt is not reported

Doubt = Callable[[SessionContext, PortState, Value], bool]


@dataclass(slots=True)
class SecondLook:
    """Second look at doubtful values of one reading."""

    reading: ScheduledRead
    port: PortState
    question: PreparedRead
    doubt: Doubt | None
    possible: Possible | None = None
    heard_at: float | None = None  # time of the last accepted answer
    reported_at: float | None = None  # time of the last doubtful one

    def is_due(self, context: SessionContext, value: Value) -> bool:
        """Return True if `value` is doubtful."""
        doubt, possible = self.doubt, self.possible
        if (doubt is None or not doubt(context, self.port, value)) and (
            possible is None or possible(value)
        ):
            return False
        # otherwise it has no meaning anyway
        return context.state.family.void(self.reading.name, self.port.tool, self.port.error) is None

    def _is_impossible(self, value: Value) -> bool:
        return self.possible is not None and not self.possible(value)

    async def settle(self, context: SessionContext, first: Value) -> Value:
        """Read again until an answer is plausible or confirmed by another.

        Raises `ImplausibleAnswer` if none is, and whatever reading raises.
        """
        given = [first]
        while len(given) < LOOKS:
            given.append(await context.station.ask(self.question))
            value = self._settled(context, given)
            if value is not None:
                return value
            if given[-1] == given[-2]:
                break  # repeated, and impossible
        context.reads.doubted[self.reading.command.name] += 1
        raise ImplausibleAnswer(
            f"{self.question.title()}: {self._shown(given)} when asked {len(given)} times"
        )

    def _settled(self, context: SessionContext, given: Sequence[Value]) -> Value | None:
        """Return the value that the last answer confirms. Mark it if it contradicts another answer,
        or is an impossible jump.
        """
        value: Value | None = given[-1]
        if not self.is_due(context, given[-1]):
            contradicts = not self._is_near(given)
        else:
            value, contradicts = self._confirmed(context, given), len(given) > 2 and not self._grows
        if value is not None and (contradicts or self._is_jump(context, value)):
            self._mark(context, given, value, is_jump=not contradicts)
        return value

    @property
    def _is_temperature(self) -> bool:
        return self.reading.name in TEMPERATURES

    @property
    def _last_c(self) -> int | None:
        """Last accepted temperature."""
        return self.port.temperatures_c.get(self.reading.name)

    @property
    def _grows(self) -> bool:
        return self.reading.counter is not None

    def _confirmed(self, context: SessionContext, given: Sequence[Value]) -> Value | None:
        """Return the value of two equal answers, if possible. A temperature may have changed a
        little between them.
        """
        if self._is_impossible(given[-1]):
            return None
        if not self._is_temperature:
            return confirmed_value(given, grows=self._grows)
        return given[-1] if self._is_near(given) else None

    def _is_near(self, given: Sequence[Value]) -> bool:
        """Return True if the last answer is a temperature close to another of the answers."""
        *before, last = given
        if not self._is_temperature or not isinstance(last, int):
            return False
        return any(isinstance(one, int) and abs(last - one) <= STILL_C for one in before)

    def _is_jump(self, context: SessionContext, value: Value) -> bool:
        """Return True if no tool can change from the last temperature to this one in the time
        between them.
        """
        known = self._last_c
        if not isinstance(value, int) or known is None or self.heard_at is None:
            return False
        spans = max((context.station.heard - self.heard_at) / JUMP_EVERY_S, 1.0)
        return abs(value - known) > context.state.family.jump_c * spans

    def _mark(
        self, context: SessionContext, given: Sequence[Value], value: Value, *, is_jump: bool
    ) -> None:
        context.reads.doubted[self.reading.command.name] += 1
        is_new = self.reported_at is None or context.now - self.reported_at > SERIES_S
        self.reported_at = context.now
        if not is_new:
            return
        if is_jump:
            text = (
                f"The {self.question.title()} jumped from {self._last_c} °C to {value} °C; a second"
                " answer bore it out."
            )
        else:
            text = (
                f"The {self.question.title()} was {self._shown(given)} when asked {len(given)}"
                " times; the last is believed."
            )
        number = float(value) if isinstance(value, int | float) else None
        raw = self.reading.command.shown(given[0])
        context.log.note(
            "read.doubted",
            Severity.INFO,
            text,
            port=self.port.number,
            since=self.heard_at,
            value=number,
            raw=raw,
        )

    def _shown(self, given: Sequence[Value]) -> str:
        return " and ".join(map(self.reading.command.shown, given))


def _differs_from_held(name: str) -> Doubt:
    return lambda context, port, value: port.held.get(name, value) != value


def _differs_from_start(name: str) -> Doubt:
    return lambda context, port, value: value != context.state.said_at_start(name)


def _differs_from_counted(name: str) -> Doubt:
    return lambda context, port, value: port.counted.get(name) != value


def _leaps(name: str) -> Doubt:
    """Return a check for a temperature too far from the last one, or without one to compare
    with.
    """

    def doubt(context: SessionContext, port: PortState, value: Value) -> bool:
        before = port.temperatures_c.get(name)
        return (
            before is None
            or not isinstance(value, int)
            or abs(value - before) > context.state.family.jump_c
        )

    return doubt


_jumps = _leaps("temperature_c")


def _decides(context: SessionContext, port: PortState, value: Value) -> bool:
    """Return True if a tip temperature leaps, makes alarms begin to count, or would confirm one."""
    if port.pulled_c == value and fell_too_fast(port, value, context.station.heard):
        return False  # confirmed when it came first, and refused again
    if _jumps(context, port, value) or not isinstance(value, int):
        return True
    return arrives(context, port, value) or bears_out(context, port, value)


DOUBTS: dict[str, Doubt] = {
    "temperature_c": _decides,
    **{name: _leaps(name) for name in ("external_c", "transistor_c", "transformer_c")},
    "status": lambda context, port, value: port.status != value,
    "tool": lambda context, port, value: port.tool != value,
    "port_error": lambda context, port, value: (port.error or 0) != value,
    "station_error": lambda context, port, value: (
        context.state.held.get("station_error", 0) != value
    ),
    "setpoint_c": lambda context, port, value: (
        port.held.get(context.state.set_name, value) != value
    ),
    "solder_shortage": differs_from_last("solder_shortage"),
    "preparing": differs_from_last("preparing"),
    "set_flow_permille": _differs_from_held("selected_air_flow"),
    **{name: _differs_from_held(name) for name in WATCHED_SETTINGS},
    **{name: _differs_from_start(name) for name in IDENTITY_READS},
}


def doubt_of(reading: ScheduledRead) -> Doubt | None:
    """Return a check for answers to `reading` that need a second one; None if none does."""
    if reading.counter is not None:
        return _differs_from_counted(reading.counter.name)
    return DOUBTS.get(reading.name)
