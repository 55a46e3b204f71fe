"""All that a run can write, as one table; anything else is refused before a byte of it is sent.

Settings that nobody asked to change are never changed. That is not left to the chapters that write: the client of a
run's station asks here first (`permit`), and what is not on the list, or carries another value than the recipe's or a
safe state's, ends the run of that station as a fault of this program (`WriteForbidden`), its tools made safe.

A guard and `jbclog safe` write `stop_feeding` and the safe states of `status`, and nothing else (`session/safety/secure.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final

from jbclog.config.recipe_settings import condition_of, settings_for, station_settings_for
from jbclog.config.write_order import COMMAND_OF
from jbclog.core.errors import WriteForbidden
from jbclog.core.quantities import Value, text_of
from jbclog.protocol.client.interface import Permit
from jbclog.protocol.commands.command import Command
from jbclog.session.run.context import SessionContext

SETTING: Final = "before sampling, where the station holds another: the recipe's `{key}`"

WRITES: Final[Mapping[str, str]] = MappingProxyType(
    {
        **{command: SETTING.format(key=key) for key, command in COMMAND_OF.items()},
        "status": "after the settings: the recipe's `run.status`, with `air.suction`; whenever a tool is made safe: the recipe's "
        "safe state, and what follows where it is refused or does not cool",
        "stop_feeding": "whenever tools are made safe on a station with a feeder: 0",
        "store_condition": "with `--allow-omega-write`, where the controller holds another: the recipe's `[omega]`",
    }
)
"""Command -> when a run writes it, and whose value. A command that is not here is never written by a run."""


def listed(context: SessionContext) -> Permit:
    """What `context`'s client asks before each write: raises `WriteForbidden` for what the run may not send."""

    def permit(command: Command, value: Value, port: int | None, tool: int | None) -> None:
        if command.name not in WRITES:
            raise WriteForbidden(f"{_title(context, command, port)} is nothing that a run may write; it was not sent")
        if value not in _values(context, command, port) or not _is_its_tool(context, port, tool):
            asked = f"{_title(context, command, port)}: nobody asked for {text_of(value)}"
            raise WriteForbidden(f"{asked}; it was not sent")

    return permit


def _values(context: SessionContext, command: Command, port: int | None) -> Iterator[Value]:
    """The values that may be written there."""
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
    """The word of the start, and those that make the tool safe."""
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
    for setting in station_settings_for(recipe, family) if port is None else settings_for(recipe, family, port):
        counted = setting.as_counted(context.held)
        if setting.command.name == command.name and counted is not None:
            yield counted.value


def _is_its_tool(context: SessionContext, port: int | None, tool: int | None) -> bool:
    """Whether the port is one of this run's, and the tool the one that is connected there."""
    if port is None:
        return tool is None
    state = context.ports.get(port)
    return state is not None and tool in (None, state.tool)


def _title(context: SessionContext, command: Command, port: int | None) -> str:
    name = command.name.replace("_", " ")
    return f"{context.name}: {name if port is None else f'{name} of port {port}'}"
