"""Output of the commands: data on stdout, notes on stderr, one JSON object with --json, errors
without tracebacks.
"""

from __future__ import annotations

import errno
import os
import shutil
import sys
import textwrap
import threading
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import wraps
from itertools import zip_longest
from typing import TYPE_CHECKING, ParamSpec

import typer

from jbclog.cli.streams import keep_failed_write, point_to_null, writes_unicode
from jbclog.core.disk_space import write_failure
from jbclog.core.errors import (
    JbclogError,
    Problems,
    RecordError,
    UsageError,
    unexpected_error_text,
)
from jbclog.core.text import clean, count_text, json_line, shortened

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from jbclog.analysis.runs import Runs

P = ParamSpec("P")
INTERNAL_ERROR = 1
FOLDER_GONE = "the current folder was removed; change into another one (`cd`) and try again"
GAP = 2  # cells between two columns
MOST_SHOWN = 10_000  # characters of a line or cell; --json has all of it


def shown(text: str) -> str:
    """Return a text for display: on one line, without hidden characters, of bounded length."""
    if len(text) <= MOST_SHOWN and text.isprintable():
        return text
    return shortened(clean(text), MOST_SHOWN)


def echo(*lines: str) -> None:
    """Print lines of data on stdout, each on one line. Ignores a closed stdout."""
    _echo([shown(line) for line in lines], err=False)


def echo_words(*lines: str) -> None:
    """Print lines for people on stdout, wrapped between words on a terminal."""
    cleaned = [shown(line) for line in lines]
    _echo([wrapped(line) for line in cleaned] if sys.stdout.isatty() else cleaned, err=False)


def note(*lines: str) -> None:
    """Print lines for people on stderr, wrapped between words on a terminal."""
    cleaned = [shown(line) for line in lines]
    _echo([wrapped(line) for line in cleaned] if is_terminal() else cleaned, err=True)


def save_figure(figure: Figure, plot: Path) -> None:
    """Write a figure to a file and print its name. Raises `RecordError`."""
    try:
        figure.savefig(plot, dpi=150)
    except OSError as error:
        raise RecordError(f"{plot}: cannot write: {write_failure(error, plot)}") from error
    note(f"written: {plot}")


def note_unreadable(runs: Runs) -> None:
    """Print a line for each unreadable run without a warning so far."""
    for one in runs.unreadable:
        note(f"{one.folder}: {one.why}")


def note_copies(runs: Runs) -> None:
    """Print a line for each of the first folders that do not count because another one has the
    run.
    """
    from jbclog.record.find_runs import copies_texts

    note(*copies_texts(runs.copies))


def run_facts(folder: Path) -> dict[str, object]:
    """Return a run's name and its folder as JSON data."""
    return {"run": folder.absolute().name, "folder": str(folder)}


def echo_json(data: object) -> None:
    """Print one JSON object on one line of stdout."""
    _echo([json_line(data, only_ascii=not writes_unicode())], err=False)


def echo_table(
    heads: Sequence[str], rows: Iterable[Sequence[str]], *, cut: int | None = None
) -> None:
    """Print a table on stdout. A terminal shows at most `cut` cells of each column but the last;
    elsewhere it is complete.
    """
    _echo(table_lines(heads, rows, cut=cut if sys.stdout.isatty() else None), err=False)


def table_lines(
    heads: Sequence[str], rows: Iterable[Sequence[str]], *, cut: int | None = None
) -> list[str]:
    """Return a table without borders, a line per row; columns but the last are at most `cut` cells
    wide.

    rich draws the same and takes 1 ms per row.
    """
    columns = [
        *zip_longest(
            *([heads] if heads else []),
            *([shown(cell) for cell in row] for row in rows),
            fillvalue="",
        )
    ]
    if cut is not None:
        columns[:-1] = [tuple(_cut(cell, cut) for cell in column) for column in columns[:-1]]
    return [
        "".join(row).rstrip() for row in zip(*(_padded(column) for column in columns), strict=True)
    ]


def _padded(column: Sequence[str]) -> list[str]:
    lengths = [len(cell) if cell.isascii() else _cell_len(cell) for cell in column]
    width = max(lengths) + GAP
    return [cell + " " * (width - length) for cell, length in zip(column, lengths, strict=True)]


def _cell_len(cell: str) -> int:
    from rich.cells import cell_len

    return cell_len(cell)


def _cut(cell: str, most: int) -> str:
    from rich.cells import set_cell_size

    return cell if _cell_len(cell) <= most else set_cell_size(cell, most - 1) + "…"


def _echo(lines: list[str], *, err: bool) -> None:
    if not lines:
        return
    try:
        typer.echo("\n".join(lines), err=err)
    except OSError as error:  # the reader has closed it, or the disk is full
        point_to_null(2 if err else 1)
        if not err:
            keep_failed_write(error)


def wrapped(text: str, columns: int | None = None) -> str:
    """Return `text` wrapped to a terminal's width between words, so that paths can be copied."""
    width = max(columns or shutil.get_terminal_size().columns, 40) - 1
    return "\n".join(_wrapped_line(line, width) for line in text.split("\n"))


def _wrapped_line(line: str, width: int) -> str:
    indent = line[: len(line) - len(line.lstrip())]
    pieces = textwrap.wrap(
        line, width, subsequent_indent=indent + "  ", break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(pieces)


def is_terminal() -> bool:
    """Return whether notes go to a terminal."""
    return sys.stderr.isatty()


def reports_errors(verb: Callable[P, None]) -> Callable[P, None]:
    """Wrap a command: an error ends it with one line and its exit code."""

    @wraps(verb)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            with warnings.catch_warnings():
                warnings.showwarning = _note_warning
                verb(*args, **kwargs)
        except JbclogError as error:
            _print_error(error, as_json=bool(kwargs.get("as_json")))
            raise typer.Exit(error.exit_code) from error
        except KeyboardInterrupt:
            raise typer.Exit(130) from None
        except typer.Exit:
            raise
        except typer.Abort as end:
            if isinstance(end.__context__, KeyboardInterrupt):  # at a prompt
                raise typer.Exit(130) from None
            raise
        except Exception as error:
            if isinstance(error, FileNotFoundError) and _is_folder_gone():
                gone = UsageError(FOLDER_GONE)
                _print_error(gone, as_json=bool(kwargs.get("as_json")))
                raise typer.Exit(gone.exit_code) from error
            if os.environ.get("JBCLOG_TRACEBACK") or _is_limit_of_files(error):
                raise  # too many open files: `main` reports it
            text = (
                f"internal error, {unexpected_error_text(error)} (set JBCLOG_TRACEBACK=1 to see"
                " where; please report it)"
            )
            note(f"jbclog: {text}")
            if kwargs.get("as_json"):
                echo_json(
                    {"error": type(error).__name__, "problems": [text], "exit_code": INTERNAL_ERROR}
                )
            raise typer.Exit(INTERNAL_ERROR) from error

    return wrapper


def _note_warning(message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning as one line; Python would add code and print foreign text unchanged."""
    note(f"warning: {message}")


def _is_folder_gone() -> bool:
    """Whether the current folder was removed: then no relative path leads anywhere."""
    try:
        os.getcwd()  # noqa: PTH109  # what fails in all of them
    except FileNotFoundError:
        return True
    return False


def _is_limit_of_files(error: BaseException) -> bool:
    return isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE)


def note_thread_error(failed: threading.ExceptHookArgs) -> None:
    """Print the error that ended a thread as one line, instead of a traceback."""
    if os.environ.get("JBCLOG_TRACEBACK"):
        threading.__excepthook__(failed)
    elif failed.exc_value is not None and not isinstance(failed.exc_value, SystemExit):
        name = "a thread" if failed.thread is None else f"the thread {failed.thread.name}"
        is_limit = _is_limit_of_files(failed.exc_value)
        hint = (
            "; raise the limit of open files (`ulimit -n`)"
            if is_limit
            else " (set JBCLOG_TRACEBACK=1 to see where)"
        )
        with suppress(Exception):  # if this cannot be written, a traceback cannot either
            note(f"error: {name} ended: {unexpected_error_text(failed.exc_value)}{hint}")


def _print_error(error: JbclogError, *, as_json: bool) -> None:
    if isinstance(error, Problems):
        note(*(f"error: {problem}" for problem in error.problems))
        note(f"{count_text(len(error.problems), 'problem')}; nothing sent")
    else:
        note(f"error: {error}")
    if as_json:
        problems = (
            [str(problem) for problem in error.problems]
            if isinstance(error, Problems)
            else [str(error)]
        )
        echo_json(
            {"error": type(error).__name__, "problems": problems, "exit_code": error.exit_code}
        )
