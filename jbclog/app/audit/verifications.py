"""When each tip was verified last, from the file of verifications beside the runs, as if somebody had told the ledger."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from jbclog.config.tasks_file import Task
from jbclog.core.errors import RecordError
from jbclog.maintenance.counter_totals.observed import Fact
from jbclog.maintenance.verification.verification import Verification
from jbclog.maintenance.verification.verifications_file import NAME, Book, last_valid, places_of, read_book

TASK: Final = "verification"
"""The task whose last time verifications tell."""

Place = tuple[str, str]
"""Line and station."""


def verified(runs: Path, places: Iterable[Place]) -> tuple[list[Fact], list[str]]:
    """The last valid verification of each port of these stations; and what is wrong with the file. Never raises.

    The file knows stations by their names alone: where two lines have one of a name, it is of both.
    """
    try:
        book = read_book(runs)
    except RecordError as error:
        return [], [str(error)]
    wrong = [f"{runs / NAME}: line {number} {text}" for number, text in book.wrong if "cut off" not in text]
    return [_fact(place, one, runs) for place in places for one in _last(book, place[1])], wrong


def _last(book: Book, station: str) -> Iterator[Verification]:
    for port in places_of(book, station):
        one = last_valid(book, station, port)
        if one is not None:
            yield one


def _fact(place: Place, one: Verification, runs: Path) -> Fact:
    time = datetime.fromisoformat(one.time).astimezone(UTC).isoformat(timespec="milliseconds")
    text = f"port {one.port} verified by {one.by}, {one.result.upper()}: line {one.seq} of {runs / NAME}"
    return Fact(time, time, one.by, *place, TASK, one.port, one.tip, text)


def with_never(tasks: Sequence[Task], runs: Path) -> list[Task]:
    """The tasks, of which that of verifications says that no verification is known."""
    never = f"never verified, as far as {runs / NAME} and the ledger tell"
    return [replace(task, never=never) if task.name == TASK else task for task in tasks]
