"""How verbs speak: data on stdout, notes on stderr, one JSON object where it is asked for, errors without tracebacks."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec

import typer

from jbclog.errors import JbclogError, Problems

P = ParamSpec("P")
INTERNAL_ERROR = 1


def tell(text: str = "") -> None:
    """A line of data, on stdout. A closed stdout is no reason to stop."""
    _echo(text, err=False)


def note(text: str = "") -> None:
    """A line for people, on stderr."""
    _echo(text, err=True)


def tell_json(data: object) -> None:
    """One JSON object, on one line of stdout."""
    tell(json.dumps(data, ensure_ascii=False, default=str))


def _echo(text: str, *, err: bool) -> None:
    try:
        typer.echo(printable(text), err=err)
    except BrokenPipeError:
        stream = sys.stderr if err else sys.stdout
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def printable(text: str) -> str:
    """`text` without control characters: a station's name or answer must not steer a terminal."""
    return "".join(c if c == "\n" or c.isprintable() else "�" for c in text)


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
