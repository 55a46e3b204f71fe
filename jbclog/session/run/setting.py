"""Write one setting on one station; list everything that a run may write.

A setting is idempotent, so a failed write is repeated, `REPEATS` times at most:

1. A refusal is final, unless the write was not understood (N 1, N 2).
2. It is repeated if two answers have the value from before. A third value is a mismatch.
3. If it cannot be read back, it is repeated once the link has answered another request; a setting
   that can heat (`config.recipe.CAN_HEAT`) never is without those two answers.
4. Nothing is repeated once the run is ending: `RunEnded` passes through here.

Each repeated write is a row of `settings` (``repeated``), an event and a count in the station's
facts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NoReturn

from jbclog.config.recipe import CAN_HEAT, COMMAND_OF
from jbclog.config.recipe_settings import condition_of, settings_for, station_settings_for
from jbclog.core.errors import (
    LinkError,
    NotReceived,
    Refusal,
    StartRefused,
    StationError,
    WriteForbidden,
)
from jbclog.core.io_requests import RunEnded, Steps, Wait
from jbclog.core.quantities import Value, text_of
from jbclog.core.rows import SettingOutcome, SettingRow, Severity
from jbclog.protocol.client.confirmed_reads import SETTLE_S
from jbclog.protocol.client.interface import Permit
from jbclog.protocol.commands.command import Command, Scope
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.identify import StationAbsent

# Everything that a run can write is in this table. The client of a run's station calls `permit`
# before each write. A command that is not listed, or another value than the recipe's or a safe
# state's, is a bug: it ends the run of that station (`WriteForbidden`), with its tools made safe.
#
# A guard and `jbclog safe` write only `stop_feeding` and the safe states of `status`
# (`session/safety/secure.py`).

SETTING: Final = "before sampling, where the station holds another: the recipe's `{key}`"

WRITES: Final[Mapping[str, str]] = MappingProxyType(
    {
        **{command: SETTING.format(key=key) for key, command in COMMAND_OF.items()},
        "status": (
            "after the settings: the recipe's `run.status`, with `air.suction`; whenever a tool is"
            " made safe: the recipe's safe state, and what follows where it is refused or does not"
            " cool"
        ),
        "stop_feeding": "whenever tools are made safe on a station with a feeder: 0",
        "store_condition": (
            "with `--allow-omega-write`, where the controller holds another: the recipe's `[omega]`"
        ),
    }
)
"""Command -> when a run writes it, and the origin of its value. A run writes no other command."""


def listed(context: SessionContext) -> Permit:
    """Return the check before each write of `context`'s client, which raises `WriteForbidden` for
    anything that the run may not send.
    """

    def permit(command: Command, value: Value, port: int | None, tool: int | None) -> None:
        if command.name not in WRITES:
            raise WriteForbidden(
                f"{_title(context, command, port)} is nothing that a run may write; it was not sent"
            )
        if value not in _values(context, command, port) or not _is_its_tool(context, port, tool):
            asked = f"{_title(context, command, port)}: the run does not allow {text_of(value)}"
            raise WriteForbidden(f"{asked}; it was not sent")

    return permit


def _values(context: SessionContext, command: Command, port: int | None) -> Iterator[Value]:
    """Yield the values that may be written."""
    if command.name == "status":
        yield from _states(context, port)
    elif command.name == "stop_feeding":
        yield 0
    elif command.name == "store_condition":
        condition = condition_of(context.recipe, context.family)
        if condition is not None and context.order.allow_omega_write:
            yield condition
    else:
        yield from _settings(context, command, port)


def _states(context: SessionContext, number: int | None) -> Iterator[Value]:
    """Yield the status word of the start, and those that make the tool safe."""
    status, port = context.family.status, context.ports.get(number or 0)
    if port is None:
        return
    word = context.start_word(port)
    if word is not None:
        yield word
    if context.safe_state in status.orders:
        yield from status.safe_words(context.safe_state, suction=context.keeps_suction(port))


def _settings(context: SessionContext, command: Command, port: int | None) -> Iterator[Value]:
    recipe, family = context.recipe, context.family
    for setting in (
        station_settings_for(recipe, family) if port is None else settings_for(recipe, family, port)
    ):
        counted = setting.as_counted(context.held)
        if setting.command.name == command.name and counted is not None:
            yield counted.value


def _is_its_tool(context: SessionContext, port: int | None, tool: int | None) -> bool:
    """Return True if the port is one of this run's, and the tool the one connected to it."""
    if port is None:
        return tool is None
    state = context.ports.get(port)
    return state is not None and tool in (None, state.tool)


def _title(context: SessionContext, command: Command, port: int | None) -> str:
    name = command.name.replace("_", " ")
    return f"{context.name}: {name if port is None else f'{name} of port {port}'}"


ROBOT_MODE_OFF: Final = (
    ", Robot mode is off, although it answers reads; switch it on in the station's menu"
)
REPEATS: Final = 3


@dataclass(slots=True)
class _Try:
    """Result of one write: the value read back (None: unknown), and the errors of either."""

    found: Value | None = None
    lost: StationError | None = None
    unread: StationError | None = None

    @property
    def is_meant(self) -> bool:
        """True if the station understood the write and refused it."""
        return _is_meant(self.lost)

    @property
    def nak(self) -> int | None:
        return self.lost.code if isinstance(self.lost, Refusal) else None


def _is_meant(error: StationError | None) -> bool:
    return isinstance(error, Refusal) and not isinstance(error, NotReceived)


def read_setting(
    context: SessionContext, command: Command, port: PortState | None, known: Value | None = None
) -> Steps[Value]:
    return context.read_confirmed(command, *_place(command, port), known=known)


def _place(command: Command, port: PortState | None) -> tuple[int | None, int | None]:
    """Return port and tool for the command's code."""
    if port is None or command.scope is Scope.STATION:
        return None, None
    return port.number, port.tool if command.scope is Scope.TOOL else None


def title_of(command: Command, port: PortState | None) -> str:
    name = command.name.replace("_", " ")
    return name if port is None else f"{name} of port {port.number}"


def keep_row(
    context: SessionContext,
    command: Command,
    port: PortState | None,
    outcome: SettingOutcome,
    *,
    requested: str | None = None,
    written: str | None = None,
    readback: str | None = None,
    nak: int | None = None,
) -> None:
    tool = context.tool_text(port.tool) if port and command.scope is Scope.TOOL else None
    time, number = context.utc.micros(context.now), port.number if port else None
    row = SettingRow(
        time,
        context.name,
        number,
        tool,
        command.name,
        command.unit,
        requested,
        written,
        readback,
        nak,
        outcome,
    )
    context.journal.setting(row)


def touch(context: SessionContext, port: PortState | None) -> None:
    """Register that this run may change the port or the feeder, which is then made safe at the
    end.
    """
    if port is None:
        news, context.feeder_touched = not context.feeder_touched, True
    else:
        news, port.touched = port.number not in context.facts.touched, True
    if news:
        context.publish()  # guard and recovery must know hot tools before they are hot


def write_setting(
    context: SessionContext, command: Command, value: Value, port: PortState | None
) -> Steps[None]:
    """Write until the value is read back. Raises `StartRefused` if it is not, `StationAbsent` if
    the link breaks.

    After an exception the write may or may not have been executed.
    """
    before, requested = (
        (context.held if port is None else port.held).get(command.name),
        text_of(value),
    )
    if before is not None:
        # the only record of the previous value
        keep_row(context, command, port, SettingOutcome.READ, readback=text_of(before))
    touch(context, port)
    try:
        yield from _write(context, command, value, port, before)
    except (LinkError, RunEnded) as error:
        keep_row(
            context,
            command,
            port,
            SettingOutcome.UNCONFIRMED,
            requested=requested,
            written=requested,
        )
        if isinstance(error, RunEnded):
            raise
        raise StationAbsent(
            _failed(context, command, port, value, before, f"it could not be read back ({error})")
        ) from error


def _write(
    context: SessionContext,
    command: Command,
    value: Value,
    port: PortState | None,
    before: Value | None,
) -> Steps[None]:
    for number in range(1, 2 + REPEATS):
        one = yield from _try(context, command, value, port)
        if one.is_meant:
            _refuse(context, command, value, port, before, one, number)
        if one.found is not None and _is_same(context, command, one.found, value):
            context.written.append(
                f"{title_of(command, port)} {command.shown(value)} (was {_shown(command, before)})"
            )
            _end(context, command, value, port, SettingOutcome.CONFIRMED, one)
            return
        if number > REPEATS or not (yield from _may_repeat(context, command, one, before)):
            _refuse(context, command, value, port, before, one, number)
        _report_repeated(context, command, value, port, one, number)


def _try(
    context: SessionContext, command: Command, value: Value, port: PortState | None
) -> Steps[_Try]:
    """Write once and read back; the read-back decides even after a lost acknowledgement. A refusal
    needs none.
    """
    one = _Try()
    try:
        yield from context.station.write(command, value, *_place(command, port), once=True)
    except StationError as error:
        one.lost = error
        if one.is_meant:
            return one
    try:
        one.found = yield from read_setting(context, command, port)
    except StationError as error:
        one.unread = error
    return one


def _may_repeat(
    context: SessionContext, command: Command, one: _Try, before: Value | None
) -> Steps[bool]:
    """Return True if the link has settled and the previous value is still in force; for a setting
    that cannot heat, if it may be.
    """
    if one.found is not None:
        if one.found != before:
            return False
        context.station.unasked((yield Wait(context.now + SETTLE_S)))
        return True
    if command.name in CAN_HEAT or _is_meant(one.unread):
        return False
    try:
        yield from context.read_confirmed(context.command("model"), known=context.facts.model)
    except StationError:
        return False
    return True


def _is_same(context: SessionContext, command: Command, found: Value, value: Value) -> bool:
    if found == value:
        return True
    if command.name != "status" or not isinstance(found, tuple) or not isinstance(value, tuple):
        return False
    status = context.family.status
    # the recipe does not set it: anybody may switch it
    is_suction_free = context.recipe.suction == "keep"
    return status.confirms(found, value) and (
        is_suction_free or status.sucks(found) == status.sucks(value)
    )


def _end(
    context: SessionContext,
    command: Command,
    value: Value,
    port: PortState | None,
    outcome: SettingOutcome,
    one: _Try,
) -> None:
    """Record the last write, and store the held value as far as it is known."""
    readback = None if one.found is None else text_of(one.found)
    nak = one.nak if outcome == SettingOutcome.REFUSED else None
    keep_row(
        context,
        command,
        port,
        outcome,
        requested=text_of(value),
        written=text_of(value),
        readback=readback,
        nak=nak,
    )
    if one.found is not None:
        (context.held if port is None else port.held)[command.name] = one.found


def _refuse(
    context: SessionContext,
    command: Command,
    value: Value,
    port: PortState | None,
    before: Value | None,
    one: _Try,
    number: int,
) -> NoReturn:
    """Raise `StartRefused` with the reason and the number of writes."""
    if one.nak is not None and one.found in (None, before):
        outcome, why = (
            SettingOutcome.REFUSED,
            f"the station refused it with N {one.nak:05d}{ROBOT_MODE_OFF if one.nak == 5 else ''}",
        )
        one.found = None
    elif one.found is None:
        outcome, why = SettingOutcome.UNCONFIRMED, f"it could not be read back ({one.unread})"
    else:
        outcome, why = SettingOutcome.MISMATCH, f"{command.shown(one.found)} was read back"
    _end(context, command, value, port, outcome, one)
    why += "" if one.is_meant else f", in {number} write{'' if number == 1 else 's'}"
    error = _failed(context, command, port, value, before, why)
    raise StartRefused(error) from (one.unread or one.lost)


def _failed(
    context: SessionContext,
    command: Command,
    port: PortState | None,
    value: Value,
    before: Value | None,
    why: str,
) -> str:
    return (
        f"{context.name}: {title_of(command, port)}: requested {command.shown(value)}, but {why};"
        f" previous value: {_shown(command, before)}"
    )


def _shown(command: Command, before: Value | None) -> str:
    return "unknown" if before is None else command.shown(before)


def _report_repeated(
    context: SessionContext,
    command: Command,
    value: Value,
    port: PortState | None,
    one: _Try,
    number: int,
) -> None:
    readback = None if one.found is None else text_of(one.found)
    requested = text_of(value)
    keep_row(
        context,
        command,
        port,
        SettingOutcome.REPEATED,
        requested=requested,
        written=requested,
        readback=readback,
        nak=one.nak,
    )
    context.facts.settings_repeated += 1
    stands = (
        "it could not be read back"
        if one.found is None
        else f"{command.shown(one.found)} is still set"
    )
    lost = "acknowledged" if one.lost is None else str(one.lost)
    what = title_of(command, port)
    text = (
        f"{what[:1].upper()}{what[1:]}: {command.shown(value)} did not take effect"
        f" ({lost}; {stands}). It is written again (write {number + 1} of at most {1 + REPEATS})."
    )
    context.note(
        "setting.repeated",
        Severity.WARNING,
        text,
        port=port.number if port else None,
        value=number + 1,
    )
