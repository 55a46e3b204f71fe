"""The program and its commands."""

from __future__ import annotations

import errno
import os
import sys
import threading
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any, Final

import typer
from typer.main import get_command

from jbclog import __version__
from jbclog.cli.help import Program, Verb
from jbclog.cli.streams import make_usable
from jbclog.core.outcome import Exit

NO_MEMORY: Final = b"jbclog: memory was refused; `jbclog recover` finishes the record\n"

NO_FILES: Final = b"error: too many open files for this process; raise the limit (`ulimit -n`)\n"

COMMANDS: Final = {
    "Record": {
        "demo": "Demonstrate a run on four virtual stations, recipe to report.",
        "plan": "Show what a run would write, and which rate fits.",
        "run": "Apply a recipe, confirm every setting, and record.",
        "watch": "Watch a run while it is recorded.",
        "batch": "Run a queue of jobs on the stations of a line.",
        "safe": "Put every tool of a line in its safe state, now.",
        "recover": "Finish runs that a crash left open.",
        "replay": "Replay a run recorded with --wire, or reproduce it.",
    },
    "Stations": {
        "init": "Write a first line file and recipe, by questions.",
        "sim": "Serve a line's stations as virtual ones, until Ctrl-C.",
        "scan": "Find stations and their link settings.",
        "doctor": "Diagnose this machine's setup and suggest fixes.",
        "read": "Read one value of a station, or all.",
        "write": "Write one setting by name and read it back.",
    },
    "Analyse": {
        "runs": "Find runs by operator, order, unit, time, verdict and more.",
        "report": "Write a run's report: page, PDF to sign, JSON and tables.",
        "export": "Export a run for spreadsheets, measurement tools or Q-DAS.",
        "check": "Check a run's integrity.",
        "alarms": "Show a run's alarms as episodes, or acknowledge one.",
        "annotate": "Add a permanent note to a sealed run.",
        "compare": "Compare two runs side by side.",
        "trend": "Show a metric over many runs: control chart, capability.",
        "chart": "Show control charts and capability within a run or over runs.",
        "limits": "Learn fixed control limits from stable runs, or show them.",
        "publish": "Publish sealed runs into a plant's store.",
        "store": "Check a plant's store, join its small files, or free space.",
    },
    "Maintain": {
        "verify": "Record a tip verification against an external thermometer.",
        "where-used": "List the runs that used a tip since its last pass.",
        "audit": "Read the counters and report which maintenance is due.",
        "maintenance": "Record maintenance done on a station, or list it.",
    },
}
"""Groups of commands, with the first sentence of each: `--help` loads none of them."""


class Commands(Mapping[str, Any]):
    """The commands by their names; each is loaded when it is looked up."""

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
    """Return the command `name`: the function of that name in the module of that name."""
    word = name.replace("-", "_")
    module = import_module(f"jbclog.cli.{word}")
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    alone.command(name, cls=getattr(module, "COMMAND_CLASS", Verb))(getattr(module, word))
    return get_command(alone)


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
    help=(
        "Apply a recipe to soldering stations, confirm it, record and report.\n\nStart with `jbclog"
        " demo`: it needs no station.\n\nExit codes: 0 fine · 1 completed with findings · 2 wrong"
        " usage, nothing sent · 3 a station did not start or was disconnected at the end · 4 the"
        " record is incomplete · 5 a tool is not confirmed safe · 130/143 interrupted."
    ),
)


def _version(is_set: bool) -> None:
    if is_set:
        typer.echo(f"jbclog {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Show the version and exit."
    ),
) -> None: ...


def _note_thread_error(failed: threading.ExceptHookArgs) -> None:
    # not loaded by --help; a command that has threads has loaded it
    from jbclog.cli.output import note_thread_error

    note_thread_error(failed)


def main() -> None:
    """Run the command `jbclog`.

    Memory can be refused once more while a refusal is handled. Ending then needs none: no exception
    and no text are made.
    """
    make_usable()
    threading.excepthook = _note_thread_error
    try:
        app()
    except MemoryError:
        os.write(2, NO_MEMORY)
        os._exit(Exit.RECORD)
    except OSError as error:
        if error.errno not in (errno.EMFILE, errno.ENFILE):
            raise
        os.write(2, NO_FILES)  # what prints otherwise may not be loaded, and cannot be any more
        sys.exit(Exit.RECORD)
