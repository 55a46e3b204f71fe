"""The page of ``jbclog --help``, without the command-line library, whose import takes longer than
all of this. For everything else `app.py` makes the same page with the library.
"""

from __future__ import annotations

import os
import shutil
import sys
from textwrap import fill, wrap

from jbclog.cli.streams import STDOUT, keep_failed_write, make_usable, point_to_null

ABOUT = (
    "Apply a recipe to soldering stations, confirm it, record and report.\n\nStart with `jbclog"
    " demo`: it needs no station.\n\nExit codes: 0 fine · 1 completed with findings · 2 wrong"
    " usage, nothing sent · 3 a station did not start or was disconnected at the end · 4 the record"
    " is incomplete · 5 a tool is not confirmed safe · 130/143 interrupted."
)

OPTIONS = {
    "--version": "Show the version and exit.",
    "--install-completion": "Install completion for the current shell.",
    "--show-completion": (
        "Show completion for the current shell, to copy it or customize the installation."
    ),
    "-h, --help": "Show this message and exit.",
}

COMMANDS = {
    "Record": {
        "demo": "Demonstrate a run on four virtual stations, recipe to report.",
        "plan": "Show what a run would write, and which rate fits.",
        "run": "Apply a recipe, confirm every setting, and record.",
        "watch": "Watch a run while it is recorded.",
        "batch": "Run a queue of jobs on the stations of a line.",
        "safe": "Put every tool of a line in its safe state, now.",
        "recover": "Finish runs that a crash left open.",
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
        "publish": "Copy sealed runs into a plant's folder or S3.",
    },
    "Maintain": {
        "verify": "Record a tip verification against an external thermometer.",
        "where-used": "List the runs that used a tip since its last pass.",
        "audit": "Read the counters and report which maintenance is due.",
        "maintenance": "Record maintenance done on a station, or list it.",
    },
}
"""Groups of commands, with the first sentence of each, because `--help` imports none of them."""

WIDEST, NARROWEST = 80, 50


def is_shown() -> bool:
    """Show the page if the words ask for it and nothing else; return whether it was shown."""
    if sys.argv[1:] not in (["--help"], ["-h"]):
        return False
    make_usable()
    try:
        print(page(_name(), shutil.get_terminal_size().columns), flush=True)
    except OSError as error:  # closed by its reader, or the disk is full
        keep_failed_write(error)
        point_to_null(STDOUT)
        return False  # `app.main` ends as any other command does
    return True


def _name() -> str:
    """Return how the program was called."""
    module = getattr(sys.modules["__main__"], "__package__", None)
    return f"python -m {module}" if module else os.path.basename(sys.argv[0])  # noqa: PTH119  # pathlib takes 3 ms


def page(name: str, columns: int) -> str:
    """Return the page for a program called `name` on a terminal of this many columns."""
    width = max(min(columns, WIDEST) - 2, NARROWEST)
    about = [
        fill(text, width, initial_indent="  ", subsequent_indent="  ")
        for text in ABOUT.split("\n\n")
    ]
    longest = max(len(command) for group in COMMANDS.values() for command in group)
    groups = {
        heading: {command.ljust(longest): text for command, text in group.items()}
        for heading, group in COMMANDS.items()
    }
    sections = [_section(*one, width) for one in ({"Options": OPTIONS} | groups).items()]
    return "\n\n".join([f"Usage: {name} [OPTIONS] COMMAND [ARGS]...", *about, *sections])


def _section(heading: str, texts: dict[str, str], width: int) -> str:
    column = max(map(len, texts)) + 2
    lines = [f"{heading}:"]
    for name, text in texts.items():
        first, *others = wrap(text, width - column - 2)
        lines.append(f"  {name.ljust(column)}{first}")
        lines += [" " * (column + 2) + line for line in others]
    return "\n".join(lines)
