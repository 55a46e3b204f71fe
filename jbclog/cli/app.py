"""The program and its commands."""

from __future__ import annotations

import errno
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import wraps
from importlib import import_module
from typing import Any, Final

import typer
from typer.main import get_command

from jbclog import __version__
from jbclog.cli.front_page import ABOUT, COMMANDS, OPTIONS
from jbclog.cli.help import Program, Verb
from jbclog.cli.loading import leave_out_plugins
from jbclog.cli.streams import failed_output, keep_failed_write, make_usable, point_to_null
from jbclog.core.outcome import Exit

NO_MEMORY: Final = b"jbclog: memory was refused; `jbclog recover` finishes the record\n"

READING: Final = frozenset(
    {
        *("alarms", "chart", "check", "compare", "export", "limits", "report", "runs", "trend"),
        "where-used",
    }
)
"""The commands that read records, and limit their memory."""
RECORDING: Final = frozenset(
    {
        *("audit", "batch", "demo", "doctor", "init", "read", "recover", "run", "safe"),
        *("scan", "sim", "verify", "write"),
    }
)
"""The commands that talk to stations, serve virtual ones, or finish what a recorder left: their
locks, signals and ports are those of POSIX systems.
"""
NO_MEMORY_TO_READ: Final = (
    b"error: memory was refused; `jbclog doctor` shows the limit of commands that read records\n"
)
NO_FILES: Final = b"error: too many open files for this process; raise the limit (`ulimit -n`)\n"


class Commands(Mapping[str, Any]):
    """The commands by name, imported when they are looked up."""

    def __init__(self) -> None:
        self._loaded: dict[str, Any] = {}
        self._names = [name for group in COMMANDS.values() for name in group]

    def __getitem__(self, name: str) -> Any:
        if name not in self._names:
            raise KeyError(name)
        if name not in self._loaded:
            self._loaded[name] = _load(name)
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def _load(name: str) -> Any:
    """Import the command `name`: the function of that name in the module of that name."""
    word = name.replace("-", "_")
    module = import_module(f"jbclog.cli.{word}")
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    verb = getattr(module, word)
    if name in RECORDING:
        verb = _where_posix(verb)
    alone.command(name, cls=getattr(module, "COMMAND_CLASS", Verb))(verb)
    return get_command(alone)


def _where_posix(verb: Callable[..., None]) -> Callable[..., None]:
    """Return the command, which elsewhere says in one line that it needs a POSIX system."""
    from jbclog.cli.output import reports_errors  # not imported by --help
    from jbclog.core.operating_system import IS_POSIX, expect_posix

    if IS_POSIX:
        return verb

    @reports_errors
    @wraps(verb)
    def refuse(**_: object) -> None:
        expect_posix()

    return refuse


class Jbclog(Program):
    """The program."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = Commands()  # type: ignore[assignment]  # nothing is added to it
        self.groups = COMMANDS


app = typer.Typer(
    name="jbclog",
    cls=Jbclog,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help=ABOUT,
)


def _version(is_set: bool) -> None:
    if is_set:
        typer.echo(f"jbclog {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help=OPTIONS["--version"]
    ),
) -> None: ...


def _note_thread_error(failed: threading.ExceptHookArgs) -> None:
    # not imported by --help; a command with threads has imported it
    from jbclog.cli.output import note_thread_error

    note_thread_error(failed)


def _limit_memory() -> bool:
    """Limit the memory of a command that reads records; return whether it is one."""
    if sys.argv[1:2] == [] or sys.argv[1] not in READING:
        return False
    from jbclog.core.operating_system import limit_memory  # not imported by other commands

    limit_memory()
    return True


def main() -> None:
    """Run the command `jbclog`.

    Memory can be refused again while a refusal is handled. So the exit needs none: it creates no
    exception and no text.
    """
    make_usable()
    leave_out_plugins()
    threading.excepthook = _note_thread_error
    is_reading = False
    try:
        is_reading = _limit_memory()
        app()
    except MemoryError:
        os.write(2, NO_MEMORY_TO_READ if is_reading else NO_MEMORY)
        os._exit(Exit.RECORD)
    except OSError as error:
        if error.errno in (errno.EMFILE, errno.ENFILE):
            os.write(2, NO_FILES)  # other ways to print may not be imported yet, and cannot be
            sys.exit(Exit.RECORD)
        # a command reports its own errors, so this one is of the help or the version
        keep_failed_write(error)
        point_to_null(1)
        sys.exit(_code_with_output(Exit.FINE))
    except SystemExit as end:
        raise SystemExit(_code_with_output(end.code)) from None


def _code_with_output(code: str | int | None) -> str | int | None:
    """Return the exit code; `Exit.OUTPUT` where it said that all is well, or what was found, and
    stdout could not be written.
    """
    if code not in (None, Exit.FINE, Exit.NOT_FINE):
        return code
    failure = failed_output()
    if failure is None:
        return code
    text = f"error: standard output is incomplete: {failure}; free space there\n"
    with suppress(OSError):
        os.write(2, text.encode(errors="backslashreplace"))
    return Exit.OUTPUT.value
