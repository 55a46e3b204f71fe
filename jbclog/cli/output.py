"""How verbs speak: data on stdout, notes on stderr, one JSON object where it is asked for, errors without tracebacks."""

from __future__ import annotations

import json
import os
import shutil
import sys
import textwrap
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec

import typer

from jbclog.cli.streams import point_to_null, writes_unicode
from jbclog.errors import JbclogError, Problems

P = ParamSpec("P")
INTERNAL_ERROR = 1


def tell(text: str = "") -> None:
    """A line of data, on stdout. A closed stdout is no reason to stop."""
    _echo(text, err=False)


def note(text: str = "") -> None:
    """A line for people, on stderr; on a terminal broken between words."""
    _echo(wrapped(text) if is_terminal() else text, err=True)


def tell_json(data: object) -> None:
    """One JSON object, on one line of stdout."""
    tell(json.dumps(data, ensure_ascii=not writes_unicode(), default=str))


def _echo(text: str, *, err: bool) -> None:
    try:
        typer.echo(printable(text), err=err)
    except OSError:  # nobody reads it any more, or its disk is full
        point_to_null(2 if err else 1)


def printable(text: str) -> str:
    """`text` without control characters: a station's name or answer must not steer a terminal."""
    return "".join(c if c == "\n" or c.isprintable() else "�" for c in text)


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
            note(f"jbclog: internal error, {type(error).__name__}: {error} (JBCLOG_TRACEBACK=1 shows where; please report it)")
            raise typer.Exit(INTERNAL_ERROR) from error

    return told


def _tell_error(error: JbclogError, *, as_json: bool) -> None:
    if isinstance(error, Problems):
        note("\n".join(f"error: {problem}" for problem in error.problems))
        note(f"{len(error.problems)} problem{'s' if len(error.problems) > 1 else ''}; nothing was sent.")
    else:
        note(f"error: {error}")
    if as_json:
        problems = [str(problem) for problem in error.problems] if isinstance(error, Problems) else [str(error)]
        tell_json({"error": type(error).__name__, "problems": problems, "exit_code": error.exit_code})
