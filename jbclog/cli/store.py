"""`jbclog store`: check a plant's store, join its small files, delete what no version needs."""

from __future__ import annotations

from dataclasses import asdict
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import echo, echo_json, note, reports_errors
from jbclog.core.errors import UsageError
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from jbclog.analysis.store.place import Place

WORDS = ("check", "compact", "vacuum")


@reports_errors
def store(
    word: str = typer.Argument(
        ..., metavar="check|compact|vacuum", help="What to do.", show_default=False
    ),
    store: Path = options.STORE,
    older_than: str = typer.Option(
        "24h",
        "--older-than",
        metavar="TIME",
        help="check: age from which an interrupted publisher's rows are removed.",
    ),
    days: float = typer.Option(
        7.0, "--days", metavar="N", help="vacuum: keep files of the last N days, 7 or more."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Check a plant's store, join its small files, or free space.

    `check` compares each run's rows and each file with what was published, and removes rows that
    interrupted publishers left, unless a publisher is at work; exit code 1: damage. `compact` joins
    small files, also beside publishers. `vacuum` deletes files that no version of the last days
    needs; it is refused below seven days, and beside a publisher.

    \b
    Example:
      jbclog store check /data/plant
    """
    if word not in WORDS:
        raise UsageError(f"store {word}: give one of {', '.join(WORDS)}")
    from jbclog.analysis.store.place import expect_library, is_store, place_of

    place = place_of(store)
    if not is_store(store):
        raise UsageError(f"{store}: no store; `jbclog publish RUN {store}` makes one")
    expect_library()
    if word == "check":
        _check(place, _span(older_than), as_json=as_json)
    elif word == "compact":
        _compact(place, as_json=as_json)
    else:
        _vacuum(place, days, as_json=as_json)


def _span(text: str) -> timedelta:
    from jbclog.config.durations import EXAMPLES, span_s

    seconds = 0.0 if text.strip() in ("0", "0s", "0m", "0h") else span_s(text)
    if seconds is None:
        raise UsageError(f"--older-than {text}: give {EXAMPLES}")
    return timedelta(seconds=seconds)


def _check(place: Place, older_than: timedelta, *, as_json: bool) -> None:
    from jbclog.app.publish.upkeep import check

    found = check(place, older_than)
    if as_json:
        echo_json({"store": str(place), "agrees": not found.findings, **asdict(found)})
    else:
        note(*found.notes, *found.leftovers, *(f"removed: {text}" for text in found.removed))
        echo(*found.findings)
        result = count_text(len(found.findings), "finding") if found.findings else "no differences"
        echo(f"{place}: {result} ({count_text(found.runs, 'run')})")
    if found.findings:
        raise typer.Exit(1)


def _compact(place: Place, *, as_json: bool) -> None:
    from jbclog.app.publish.upkeep import compact

    found = compact(place)
    if as_json:
        echo_json(
            {
                "store": str(place),
                "tables": {
                    name: {"replaced": old, "by": new} for name, (old, new) in found.items()
                },
            }
        )
        return
    for name, (old, new) in found.items():
        if old:
            echo(f"{name}: {count_text(old, 'file')} joined into {new}")
    joined = count_text(sum(old for old, _ in found.values()), "file")
    echo(f"{place}: {joined} joined; `jbclog store vacuum` deletes them after seven days")


def _vacuum(place: Place, days: float, *, as_json: bool) -> None:
    from jbclog.app.publish.upkeep import vacuum

    found = vacuum(place, days)
    if as_json:
        echo_json({"store": str(place), "deleted": found})
    else:
        echo(f"{place}: {count_text(sum(found.values()), 'file')} deleted")
