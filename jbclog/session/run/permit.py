"""Everything that a run may write.

The client of a run's station calls its `WritePermit` before each write. A command that is not in
`WRITES`, or another value than the recipe's or a safe state's, is a bug: it ends the run of that
station (`WriteForbidden`), with its tools made safe.

A guard and `jbclog safe` write only `stop_feeding` and the safe states of `status`
(`session/safety/secure.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final

from jbclog.config.recipe import COMMAND_OF
from jbclog.config.recipe_settings import condition_of, settings_for, station_settings_for
from jbclog.core.errors import WriteForbidden
from jbclog.core.quantities import Value, text_of
from jbclog.protocol.commands.command import Command
from jbclog.session.run.context import SessionContext

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


class WritePermit:
    """The check before each write of a session's client."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context

    def __call__(self, command: Command, value: Value, port: int | None, tool: int | None) -> None:
        """Raise `WriteForbidden` for anything that the run may not send."""
        name = command.name.replace("_", " ")
        place = "" if port is None else f" of port {port}"
        title = f"{self._context.name}: {name}{place}"
        if command.name not in WRITES:
            raise WriteForbidden(f"{title} is nothing that a run may write; it was not sent")
        if value not in self._values(command, port) or not self._is_connected(port, tool):
            raise WriteForbidden(
                f"{title}: the run does not allow {text_of(value)}; it was not sent"
            )

    def _values(self, command: Command, port: int | None) -> Iterator[Value]:
        """Yield the values that may be written."""
        if command.name == "status":
            yield from self._status_words(port)
        elif command.name == "stop_feeding":
            yield 0
        elif command.name == "store_condition":
            order = self._context.order
            condition = condition_of(order.recipe, self._context.state.family)
            if condition is not None and order.allow_omega_write:
                yield condition
        else:
            yield from self._settings(command, port)

    def _status_words(self, number: int | None) -> Iterator[Value]:
        """Yield the status word of the start, and those that make the tool safe."""
        context = self._context
        status = context.state.family.status
        port = context.state.ports.get(number or 0)
        if port is None:
            return
        word = context.start_word(port)
        if word is not None:
            yield word
        if context.safe_state in status.orders:
            yield from status.safe_words(context.safe_state, suction=context.keeps_suction(port))

    def _settings(self, command: Command, port: int | None) -> Iterator[Value]:
        state = self._context.state
        recipe = self._context.order.recipe
        if port is None:
            settings = station_settings_for(recipe, state.family)
        else:
            settings = settings_for(recipe, state.family, port)
        for setting in settings:
            counted = setting.as_counted(state.held)
            if setting.command.name == command.name and counted is not None:
                yield counted.value

    def _is_connected(self, number: int | None, tool: int | None) -> bool:
        """Return True if the port is one of this run's, and the tool the one connected to it."""
        if number is None:
            return tool is None
        port = self._context.state.ports.get(number)
        return port is not None and tool in (None, port.tool)
