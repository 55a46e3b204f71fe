"""The program and its commands."""

from __future__ import annotations

import os
from typing import Final

import typer

from jbclog import __version__
from jbclog.cli.alarms import alarms
from jbclog.cli.annotate import annotate
from jbclog.cli.audit import audit
from jbclog.cli.batch import batch
from jbclog.cli.chart import chart
from jbclog.cli.check import check
from jbclog.cli.compare import compare
from jbclog.cli.demo import demo
from jbclog.cli.doctor import doctor
from jbclog.cli.help import ANALYSE, MAINTAIN, RECORD, STATIONS, Program, Verb
from jbclog.cli.init import init
from jbclog.cli.limits import limits
from jbclog.cli.maintenance import maintenance
from jbclog.cli.names import ReadCommand, WriteCommand
from jbclog.cli.plan import plan
from jbclog.cli.read import read
from jbclog.cli.recover import recover
from jbclog.cli.replay import replay
from jbclog.cli.report import report
from jbclog.cli.run import run
from jbclog.cli.runs import runs
from jbclog.cli.safe import safe
from jbclog.cli.scan import scan
from jbclog.cli.sim import sim
from jbclog.cli.streams import make_usable
from jbclog.cli.trend import trend
from jbclog.cli.verify import verify
from jbclog.cli.watch import watch
from jbclog.cli.where_used import where_used
from jbclog.cli.write import write
from jbclog.core.outcome import Exit

NO_MEMORY: Final = b"jbclog: memory was refused; `jbclog recover` finishes the record\n"

app = typer.Typer(
    name="jbclog",
    cls=Program,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Apply a recipe to soldering stations, confirm it, record and report.\n\n"
    "Start with `jbclog demo`: it needs no station.\n\n"
    "Exit codes: 0 fine · 1 completed with findings · 2 wrong usage, nothing sent · 3 a station did not start or was disconnected "
    "at the end · 4 the record is incomplete · 5 a tool is not confirmed safe · 130/143 interrupted.",
)


def _version(is_set: bool) -> None:
    if is_set:
        typer.echo(f"jbclog {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Show the version and exit."),
) -> None: ...


COMMANDS: Final = {
    RECORD: (demo, plan, run, watch, batch, safe, recover, replay),
    STATIONS: (init, sim, scan, doctor, read, write),
    ANALYSE: (runs, report, check, alarms, annotate, compare, trend, chart, limits),
    MAINTAIN: (verify, where_used, audit, maintenance),
}
SPECIAL: Final[dict[str, type[Verb]]] = {"read": ReadCommand, "write": WriteCommand}

for group, verbs in COMMANDS.items():
    for verb in verbs:
        name = verb.__name__.replace("_", "-")
        app.command(name, cls=SPECIAL.get(name, Verb), rich_help_panel=group)(verb)


def main() -> None:
    """Run the command `jbclog`.

    Memory can be refused once more while a refusal is handled. Ending then needs none: no exception and no text are made.
    """
    make_usable()
    try:
        app()
    except MemoryError:
        os.write(2, NO_MEMORY)
        os._exit(Exit.RECORD)
