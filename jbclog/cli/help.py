"""Help as people read it: commands in groups, values by their names alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

WrongUsage: Any = typer.BadParameter.__bases__[0]  # typer does not export it


class Program(TyperGroup):
    """A program with its commands listed in `groups`: their names, and a sentence on each."""

    groups: Mapping[str, Mapping[str, str]]

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names without loading the commands."""
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write one section for each group."""
        width = max(map(len, self.commands))
        for heading, sentences in self.groups.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(width), sentence) for name, sentence in sentences.items()])


class Verb(TyperCommand):
    """A command whose help shows neither Python types nor braces, and whose errors are JSON with --json."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse; print a wrong option or value as JSON, too, like any other error of a command."""
        has_json = "--json" in args  # parsing takes the words out
        try:
            return super().parse_args(ctx, args)
        except WrongUsage as error:
            if has_json:
                from jbclog.cli.output import echo_json  # not loaded by --help

                echo_json({"error": "UsageError", "problems": [error.format_message()], "exit_code": 2})
            raise

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the words after the command's name; an optional one is in brackets."""
        return [piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, then options."""
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            is_argument = parameter.param_type_name == "argument"
            if row := parameter.get_help_record(ctx):
                name = row[0].rpartition(" <")[0] or row[0] if is_argument else row[0]
                sections["Arguments" if is_argument else "Options"].append((name, row[1]))
        for heading, rows in sections.items():
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)
