"""How verbs speak: data on stdout, notes on stderr, one JSON object where it is asked for, errors without tracebacks."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec

import typer

from jbclog.cli.streams import point_to_null, writes_unicode
from jbclog.core.errors import JbclogError, Problems, unexpected_error_text
from jbclog.core.text import clean, json_line

P = ParamSpec("P")
INTERNAL_ERROR = 1


def tell(*lines: str) -> None:
    """Lines of data, on stdout; each is one line whatever it holds. A closed stdout is no reason to stop."""
    _echo([clean(line) for line in lines], err=False)


def note(*lines: str) -> None:
    """Lines for people, on stderr; each is one line whatever it holds, on a terminal broken between words."""
    cleaned = [clean(line) for line in lines]
    _echo([wrapped(line) for line in cleaned] if is_terminal() else cleaned, err=True)


def tell_json(data: object) -> None:
    """One JSON object, on one line of stdout."""
    _echo([json_line(data, only_ascii=not writes_unicode())], err=False)


def _echo(lines: list[str], *, err: bool) -> None:
    try:
        typer.echo("\n".join(lines), err=err)
    except OSError:  # nobody reads it any more, or its disk is full
        point_to_null(2 if err else 1)


def wrapped(text: str, columns: int | None = None) -> str:
    """`text` in lines of a terminal's width; words, and so paths and commands, are never broken."""
    width = max(columns or shutil.get_terminal_size().columns, 40) - 1
    return "\n".join(_wrapped_line(line, width) for line in text.split("\n"))


def _wrapped_line(line: str, width: int) -> str:
    indent = line[: len(line) - len(line.lstrip())]
    pieces = textwrap.wrap(line, width, subsequent_indent=indent + "  ", break_long_words=False, break_on_hyphens=False)
    return "\n".join(pieces)


def is_terminal() -> bool:
    """Whether notes go to a terminal that a person looks at."""
    return sys.stderr.isatty()


def ends_with_errors_told(verb: Callable[P, None]) -> Callable[P, None]:
    """Let a verb's errors end it with their sentence and their exit code."""

    @wraps(verb)
    def told(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            verb(*args, **kwargs)
        except JbclogError as error:
            _tell_error(error, as_json=bool(kwargs.get("as_json")))
            raise typer.Exit(error.exit_code) from error
        except KeyboardInterrupt:
            raise typer.Exit(130) from None
        except (typer.Exit, typer.Abort):
            raise
        except Exception as error:
            if os.environ.get("JBCLOG_TRACEBACK"):
                raise
            note(f"jbclog: internal error, {unexpected_error_text(error)} (JBCLOG_TRACEBACK=1 shows where; please report it)")
            raise typer.Exit(INTERNAL_ERROR) from error

    return told


def _tell_error(error: JbclogError, *, as_json: bool) -> None:
    if isinstance(error, Problems):
        note(*(f"error: {problem}" for problem in error.problems))
        note(f"{len(error.problems)} problem{'s' if len(error.problems) > 1 else ''}; nothing was sent.")
    else:
        note(f"error: {error}")
    if as_json:
        problems = [str(problem) for problem in error.problems] if isinstance(error, Problems) else [str(error)]
        tell_json({"error": type(error).__name__, "problems": problems, "exit_code": error.exit_code})
