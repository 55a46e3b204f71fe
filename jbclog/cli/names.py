"""Names of commands and settings in help and shell completion, from the command tables."""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli.help import Verb
from jbclog.core.errors import JbclogError

if TYPE_CHECKING:
    from jbclog.protocol.commands.command import Command
    from jbclog.protocol.commands.family import Family
    from jbclog.session.manual.names import CommandFilter

USUAL_LINE = Path("line.toml")  # used by completion before --line is typed
NEGATIVE = re.compile(r"-\d+(\.\d+)?", re.ASCII)
WIDEST = 100

Completions = list[tuple[str, str]]
"""Candidates, each with its help."""


class _NamingCommand(Verb):
    """A command whose help lists names of commands, and whose values may be negative numbers."""

    def get_help(self, ctx: typer.Context) -> str:  # type: ignore[override]  # the base's type is private to typer
        return "\n\n".join(
            [super().get_help(ctx).rstrip(), _shared_text(self._kind()), *self._more()]
        )

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        # -5 is not an option here
        ctx.ignore_unknown_options = any(NEGATIVE.fullmatch(word) for word in args)
        return super().parse_args(ctx, args)

    def _kind(self) -> CommandFilter:
        raise LookupError("each verb names its own kind of command")

    def _more(self) -> list[str]:
        """Return the paragraphs after the list."""
        return []


class ReadCommand(_NamingCommand):
    """`read`, with all readable names in its help."""

    def _kind(self) -> CommandFilter:
        from jbclog.session.manual.names import readable

        return readable


class WriteCommand(_NamingCommand):
    """`write`, with all writable names in its help."""

    def _kind(self) -> CommandFilter:
        from jbclog.session.manual.names import writable

        return writable

    def _more(self) -> list[str]:
        from jbclog.session.manual.names import anywhere

        dangerous = [command.name for command in anywhere().values() if command.dangerous]
        return [f"Dangerous, require --yes-i-mean STATION:\n{_wrapped(dangerous)}"]


def _shared_text(kind: CommandFilter) -> str:
    from jbclog.session.manual.names import shared

    parts = ["Names (give only a station to list its names with units, ranges and manual):"]
    for families, names in shared(kind):
        parts += ["", f"  {', '.join(families)}:", _wrapped(names)]
    return "\n".join(parts)


def _wrapped(names: Iterable[str]) -> str:
    width = min(shutil.get_terminal_size().columns, WIDEST) - 1
    text = " ".join(names)
    return textwrap.fill(
        text,
        width,
        initial_indent="    ",
        subsequent_indent="    ",
        break_long_words=False,
        break_on_hyphens=False,
    )


# -- completion ------------------------------------------------------------------------------------


def complete_station(ctx: typer.Context, incomplete: str) -> Completions:
    """Complete a station of --line, or of `line.toml` in this folder."""
    from jbclog.config.line import load_line

    try:
        stations = load_line(_line(ctx)).stations
    except (JbclogError, OSError):
        return []
    return [
        (station.name, f"{station.family} on {station.url}")
        for station in stations
        if station.name.startswith(incomplete)
    ]


def complete_signal(ctx: typer.Context, incomplete: str) -> Completions:
    """Complete a readable name of the station; of all families if it is not known."""
    from jbclog.session.manual.names import readable

    return _complete(ctx, incomplete, readable)


def complete_setting(ctx: typer.Context, incomplete: str) -> Completions:
    """Complete a writable name of the station; of all families if it is not known."""
    from jbclog.session.manual.names import writable

    return _complete(ctx, incomplete, writable)


def complete_value(ctx: typer.Context, incomplete: str) -> Completions:
    """Complete a word that the setting accepts; numbers have no completion."""
    from jbclog.protocol.commands.family import FAMILIES
    from jbclog.session.manual.names import anywhere
    from jbclog.session.manual.value_text import words_for

    name = str(ctx.params.get("setting"))
    family = _family(ctx) or next((one for one in FAMILIES.values() if name in one.commands), None)
    command = (family.commands if family else anywhere()).get(name)
    if family is None or command is None:
        return []
    return [
        (word, command.name) for word in words_for(command, family) if word.startswith(incomplete)
    ]


def _complete(ctx: typer.Context, incomplete: str, kind: CommandFilter) -> Completions:
    from jbclog.session.manual.names import anywhere

    family = _family(ctx)
    commands = (family.commands if family else anywhere()).values()
    return [
        (one.name, _about(one, family))
        for one in commands
        if kind(one) and one.name.startswith(incomplete)
    ]


def _about(command: Command, family: Family | None) -> str:
    """Return unit, scope and range: ``°C, per port; steps of 5 °C, within the station's own
    limits``.
    """
    from jbclog.session.manual.names import values_text

    place = (
        f"{command.unit}, per {command.scope.value}"
        if command.unit
        else f"per {command.scope.value}"
    )
    values = f"; {values_text(command, family)}" if command.writable and family is not None else ""
    return place + values + (" (dangerous)" if command.dangerous else "")


def _family(ctx: typer.Context) -> Family | None:
    from jbclog.app.connection import target_in

    try:
        return target_in(_line(ctx), str(ctx.params.get("station"))).family
    except (JbclogError, OSError):
        return None


def _line(ctx: typer.Context) -> Path:
    given = ctx.params.get("line")
    return Path(str(given)) if given else USUAL_LINE
