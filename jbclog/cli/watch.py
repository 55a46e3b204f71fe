"""`jbclog watch`: show a run while it is recorded."""

from __future__ import annotations

import secrets
import signal
import socket
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from jbclog.cli.options import NO_FOLDER, is_folder
from jbclog.cli.output import note, reports_errors
from jbclog.core.errors import UsageError
from jbclog.core.operating_system import lower_priority
from jbclog.core.outcome import Exit
from jbclog.transport.signals import Signals

if TYPE_CHECKING:
    from jbclog.app.watch.server import PageServer

NOT_INSTALLED: Final = "{}: `pip install 'jbclog[{}]'` installs what this view needs"
NICENESS: Final = 10
SHORTEST: Final = 16  # characters of a token


@reports_errors
def watch(
    path: Path = typer.Argument(
        Path("runs"), metavar="RUN|DIR", help="A run, or a folder of runs: its newest one."
    ),
    web: bool = typer.Option(False, "--web", help="Serve a page instead of using the terminal."),
    port: int = typer.Option(
        8765, metavar="PORT", min=0, max=65535, help="TCP port of the page; 0 takes a free one."
    ),
    address: str = typer.Option(
        "127.0.0.1",
        metavar="ADDRESS",
        help="Address of the page; others than loopback need a token.",
    ),
    token: str | None = typer.Option(
        None,
        metavar="TEXT",
        envvar="JBCLOG_WATCH_TOKEN",
        help="Token of the page, 16 characters or more.",
        show_default=False,
    ),
) -> None:
    """Watch a run while it is recorded.

    Shows each port with its condition, the last minute, alarms, joints and coverage, the events as
    they come, and a station in detail. Only reads: watching neither slows down nor changes a run. A
    value that is stale or not read is never shown as known.

    \b
    Example:
      jbclog watch runs --web --port 8765
    """
    if not is_folder(path):
        raise UsageError(NO_FOLDER.format(path))
    lower_priority(NICENESS)  # on a busy machine the recorder comes first
    if web:
        _serve(path, address, port, token)
    else:
        _show(path)


def _show(path: Path) -> None:
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise UsageError("jbclog watch needs a terminal; `--web` serves a page")
    try:
        from jbclog.app.watch.terminal import WatchApp
    except ModuleNotFoundError as error:
        raise UsageError(NOT_INSTALLED.format(error, "watch")) from None
    from jbclog.app.watch import words
    from jbclog.app.watch.batch_queue import QueueFollower
    from jbclog.live import follow

    with follow(path, joints=True) as follower:
        app = WatchApp(follower.poll, queues=QueueFollower(path).poll, no_run=words.no_run(path))
        app.run()
    raise typer.Exit(app.return_code or 0)


def _serve(path: Path, address: str, port: int, token: str | None) -> None:
    try:
        from jbclog.app.watch.server import Access, PageServer, is_loopback, listening
    except ModuleNotFoundError as error:
        raise UsageError(NOT_INSTALLED.format(error, "web")) from None
    from jbclog.app.watch import words
    from jbclog.app.watch.batch_queue import QueueFollower
    from jbclog.live import follow

    if token is not None and (len(token) < SHORTEST or not token.isascii()):
        raise UsageError(
            f"--token must have {SHORTEST} ASCII characters or more (got {len(token)})"
        )
    if token is None and not is_loopback(address):
        token = secrets.token_urlsafe(SHORTEST)
    opened = listening(address, port)
    host = f"[{address}]" if ":" in address else address
    query = "" if token is None else f"?token={token}"
    note(f"watching {path} on http://{host}:{opened.getsockname()[1]}/{query}; Ctrl-C ends it")
    with opened, follow(path, joints=True) as follower:
        if follower.poll() is None:
            note(words.no_run(path))
        _run_until_signal(
            PageServer(follower.poll, Access(address, token), path, QueueFollower(path).poll),
            opened,
        )


def _run_until_signal(server: PageServer, opened: socket.socket) -> None:
    """Serve until SIGINT or SIGTERM. After its shutdown the server raises the signal again, which
    would kill this process.
    """
    ended: list[signal.Signals] = []

    def stop(number: signal.Signals) -> None:
        ended.append(number)
        server.should_exit = True  # a signal that arrives before the server handles signals

    with Signals((signal.SIGTERM,)) as signals:
        signals.notify(stop)
        server.run([opened])
    if ended:
        raise typer.Exit(Exit.TERMINATED)
