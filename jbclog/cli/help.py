"""Help for people: commands in groups, option values without Python types."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

import typer
from typer.core import TyperCommand, TyperGroup

# typer exports neither
WrongUsage: Any = typer.BadParameter.__bases__[0]
HELP_INSTEAD: Final = "NoArgsIsHelpError"
MOST_ECHOED: Final = 1000  # characters of a message that repeats user input


@contextmanager
def cleaned_errors() -> Iterator[None]:
    """Clean the message of an error of the command-line parser, because it repeats user input. The
    help, which is printed where no command is given, repeats none.
    """
    try:
        yield
    except WrongUsage as error:
        if type(error).__name__ == HELP_INSTEAD:
            raise
        from jbclog.core.text import clean, shortened  # not imported by --help

        text = shortened(clean(error.format_message()), MOST_ECHOED)
        error.format_message = lambda: text
        raise


class Program(TyperGroup):
    """A program with its commands listed in `groups`: names, and a sentence on each."""

    groups: Mapping[str, Mapping[str, str]]

    def make_context(self, *args: Any, **more: Any) -> Any:
        """Parse the options of the program."""
        with cleaned_errors():
            return super().make_context(*args, **more)

    def invoke(self, ctx: Any) -> Any:
        """Parse the options of a command, and run it."""
        with cleaned_errors():
            return super().invoke(ctx)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names without importing the commands."""
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write one section for each group."""
        width = max(map(len, self.commands))
        for heading, sentences in self.groups.items():
            with formatter.section(heading):
                formatter.write_dl(
                    [(name.ljust(width), sentence) for name, sentence in sentences.items()]
                )


class Verb(TyperCommand):
    """A command whose help has no Python types or braces, and whose errors are JSON with --json."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse; report a wrong option or value as JSON with --json, like any other error of a
        command.
        """
        has_json = "--json" in args  # parsing consumes the words
        try:
            return super().parse_args(ctx, args)
        except WrongUsage as error:
            if has_json:
                from jbclog.cli.output import echo_json  # not imported by --help

                echo_json(
                    {"error": "UsageError", "problems": [error.format_message()], "exit_code": 2}
                )
            raise

    def invoke(self, ctx: Any) -> Any:
        """Run the command, with the garbage collector that `main` switched off while importing."""
        if not gc.isenabled():
            gc.freeze()
            gc.enable()
        return super().invoke(ctx)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the words after the command's name; an optional one is in brackets."""
        return [
            piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)
        ]

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
