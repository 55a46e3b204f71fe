"""`jbclog watch`: show a run while it is recorded."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

import typer

from jbclog.cli.options import NO_FOLDER, is_folder
from jbclog.cli.output import reports_errors
from jbclog.core.errors import UsageError

NOT_INSTALLED: Final = "{} is not installed: {}; `pip install 'jbclog[{}]'` installs it"


@reports_errors
def watch(
    path: Path = typer.Argument(Path("runs"), metavar="[RUN|DIR]", help="A run, or a folder of runs: its newest one."),
) -> None:
    """Watch a run while it is recorded.

    Shows each port with its condition, the last minute, alarms and coverage, the events as they come, and a station in detail. Only
    reads: watching neither slows down nor changes a run. A value that is stale or was not read is never shown as known.

    \b
    Example:
      jbclog watch runs
    """
    if not is_folder(path):
        raise UsageError(NO_FOLDER.format(path))
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise UsageError("jbclog watch needs a terminal")
    try:
        from jbclog.app.watch.terminal import WatchApp
    except ModuleNotFoundError as error:
        raise UsageError(NOT_INSTALLED.format("The terminal view", error, "watch")) from None
    from jbclog.live import follow

    with follow(path) as follower:
        WatchApp(follower.poll).run()
