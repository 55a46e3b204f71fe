"""docs/reference/commands.md: every command of the command line, as its own help describes it."""

from __future__ import annotations

from typer.main import get_command
from typer.testing import CliRunner

from jbclog.cli.app import app
from support.pages.md_table import MADE, code, table
from support.readers.command_line import HELP, VERBS

WIDTH = 100

INTRODUCTION = """
Each section is what `jbclog VERB --help` prints. Results go to stdout, progress and notes to stderr; `--json` prints one JSON
object on stdout. [Exit codes](exit-codes.md), [files and keys](configuration.md) and
[environment variables](environment.md) have pages of their own.
"""


def page() -> str:
    """The whole page."""
    rows = [(f"[{code(verb)}](#jbclog-{verb})", HELP[verb].splitlines()[0]) for verb in VERBS]
    sections = (f"## jbclog {verb}\n\n```text\n{help_of(verb)}\n```" for verb in VERBS)
    return (
        "\n\n".join(
            [
                f"{MADE}\n\n# Commands\n{INTRODUCTION}\n{table(('command', 'what it does'), rows)}",
                *sections,
            ]
        )
        + "\n"
    )


def help_of(verb: str) -> str:
    """What a terminal of `WIDTH` columns shows."""
    ended = CliRunner().invoke(
        app, [verb, "--help"], prog_name=get_command(app).name, terminal_width=WIDTH, color=False
    )
    return "\n".join(line.rstrip() for line in ended.stdout.strip().splitlines())
