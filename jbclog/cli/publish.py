"""`jbclog publish`: sealed runs into a plant's store."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from jbclog.cli import options
from jbclog.cli.options import NO_FOLDER, is_folder
from jbclog.cli.output import echo, echo_json, note, reports_errors
from jbclog.core.errors import UsageError
from jbclog.core.outcome import Exit
from jbclog.transport.signals import Signals

if TYPE_CHECKING:
    from jbclog.app.publish.folder import Skipped
    from jbclog.app.publish.follow import Follower, Trouble
    from jbclog.app.publish.publisher import Outcome

NICENESS: Final = 10


@reports_errors
def publish(
    path: Path = typer.Argument(
        ..., metavar="RUN|DIR", help="Sealed run, or folder of runs.", show_default=False
    ),
    store: Path = options.STORE,
    follow: bool = typer.Option(
        False, "--follow", help="Keep publishing what is sealed or annotated in DIR, until Ctrl-C."
    ),
    as_json: bool = options.JSON_PER_RUN,
) -> None:
    """Publish sealed runs into a plant's store.

    The store is a set of Delta Lake tables, which pandas, DuckDB, Polars and Spark read without
    jbclog. A run is checked first, and published once and whole: publishing it again changes
    nothing; after an annotation it adds a version. Several computers may publish at the same time.
    Refuses a place where one could overwrite another's commit. Credentials of S3 come from the
    environment (AWS_ACCESS_KEY_ID and others). Exit code 4: a run was refused, or the store is
    away. With --follow a store that goes away is tried again until it is back.

    \b
    Example:
      jbclog publish runs /data/plant
    """
    if not is_folder(path):
        raise UsageError(NO_FOLDER.format(path))
    from jbclog.analysis.store.place import expect_library, place_of

    place = place_of(store)
    expect_library()
    from jbclog.app.publish.folder import publish_all
    from jbclog.app.publish.follow import Follower
    from jbclog.app.publish.publisher import Publisher

    os.nice(NICENESS)  # on a busy machine the recorder comes first
    with Publisher(place) as publisher:
        if follow:
            _follow(Follower(publisher, path), as_json=as_json)
        refused = 0 if follow else _print(publish_all(publisher, path), as_json=as_json)
    if refused:
        raise typer.Exit(Exit.RECORD)


def _follow(follower: Follower, *, as_json: bool) -> None:
    """Publish until SIGINT, which is the normal end, or SIGTERM."""
    ended: list[signal.Signals] = []

    def end(number: signal.Signals) -> None:
        ended.append(number)
        raise KeyboardInterrupt

    with Signals((signal.SIGINT, signal.SIGTERM)) as signals:
        try:
            signals.notify(end)
            note("publishing what is sealed; Ctrl-C ends it")
            while True:
                _print(follower.poll(), as_json=as_json)
                time.sleep(follower.pause_s)
        except KeyboardInterrupt:
            raise typer.Exit(Exit.TERMINATED if signal.SIGTERM in ended else Exit.FINE) from None


def _print(those: Iterable[Outcome | Skipped | Trouble], *, as_json: bool) -> int:
    """Print the outcome of each run; return how many were refused."""
    from jbclog.app.publish.folder import Skipped
    from jbclog.app.publish.follow import Trouble

    refused = 0
    for one in those:
        if isinstance(one, Trouble):
            note(str(one))
            continue
        if isinstance(one, Skipped):
            refused += not one.is_open
            note(str(one))
        elif not as_json:
            echo(str(one))
        if as_json:
            echo_json(_facts(one))
    return refused


def _facts(one: Outcome | Skipped) -> dict[str, object]:
    from jbclog.app.publish.folder import Skipped

    if isinstance(one, Skipped):
        return {
            "run": str(one.folder),
            "result": "skipped" if one.is_open else "refused",
            "version": None,
            "why": str(one),
        }
    return {**asdict(one), "why": None}
