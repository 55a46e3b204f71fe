"""`jbclog maintenance`: record maintenance in the counter ledger, or list it."""

from __future__ import annotations

import getpass
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import echo, echo_json, echo_table, reports_errors
from jbclog.config.task_names import STATED
from jbclog.core.clock import utc_ms
from jbclog.core.errors import RecordError, UsageError

if TYPE_CHECKING:
    from jbclog.maintenance.counter_totals.observed import Fact
    from jbclog.maintenance.fleet_of_ledger import Place
    from jbclog.maintenance.ledger import Book

DONE, LIST = "done", "list"
COLUMNS = ("time", "station", "task", "by", "part", "note")
STATION = typer.Option(
    None,
    "--station",
    "-s",
    metavar="NAME",
    help="Station; LINE/NAME if two lines have it.  [required with done]",
)
TASK = typer.Option(
    None,
    "--task",
    metavar="NAME",
    help="Task, such as tip-change.  [required with done]",
    show_default=False,
)
PART = typer.Option(
    None, "--tip", "--part", metavar="ID", help="New tip, cartridge or part.", show_default=False
)


@reports_errors
def maintenance(
    word: str = typer.Argument(
        ..., metavar="done|list", help="Record maintenance, or list it.", show_default=False
    ),
    station: str | None = STATION,
    task: str | None = TASK,
    part: str | None = PART,
    port: int | None = options.PORT,
    by: str | None = typer.Option(
        None, "--by", metavar="WHO", help="Person; default: the user logged in.", show_default=False
    ),
    at: str | None = typer.Option(
        None, "--at", metavar="TIME", help="Day or time, UTC; default: now.", show_default=False
    ),
    remark: str = options.REMARK,
    ledger: Path = typer.Option(
        Path("counters.jsonl"), "--ledger", metavar="FILE", help="Ledger of `jbclog audit`."
    ),
    line: Path | None = typer.Option(
        None, "--line", "-l", metavar="FILE", help="Line file, for a station not yet audited."
    ),
    tasks: Path | None = typer.Option(
        None, "--tasks", metavar="FILE", help="Tasks file, for other task names."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Record maintenance done on a station, or list it.

    `done` appends the task, who did it and when to the ledger; `jbclog audit` counts the service
    interval from there. The tasks counters-reset, counters-rolled-over and station-replaced answer
    why a counter fell; give --at, a time between the two audits. The ledger is append-only: correct
    a mistake by another line.

    \b
    Example:
      jbclog maintenance done --station dde-1 --task tip-change --port 1 --tip T-17 --by "A. Rossi"
    """
    texts = {"--task": task, "--tip": part, "--by": by, "--note": remark}
    for option, text in texts.items():
        options.check_text(option, text or "")
    if word == LIST:
        _list(_read(ledger), station, as_json=as_json)
        return
    if word != DONE or station is None or task is None:
        raise UsageError("maintenance: give `done` with --station and --task, or `list`")
    if by is not None and not by.strip():
        raise UsageError("--by: must not be empty")
    from jbclog.maintenance.counter_totals.observed import Fact
    from jbclog.maintenance.fleet_of_ledger import (
        expect_port,
        place_of,
        task_of,
        unanswered_falls,
    )

    book = _read(ledger)
    book.expect_ledger()
    place = place_of(station, book, _places(line))
    expect_port(port, place, book)
    now = datetime.now(UTC)
    when = utc_ms(now if at is None else _moment(at, now))
    known = task_of(task, book, _names(tasks))
    if known in STATED:
        _expect_answer(known, unanswered_falls(book, place), when, station)
    _keep(
        Fact(when, utc_ms(now), by or _user(), *place, known, port, part or "", remark),
        ledger,
        as_json=as_json,
    )


def _expect_answer(task: str, falls: Sequence[tuple[str, str]], when: str, station: str) -> None:
    """Raise `UsageError` if counters fell, nobody has recorded why, and `when` is in none of these
    spans: the entry would answer nothing, and count as a reset of its own.
    """
    if not falls or any(begin < when <= end for begin, end in falls):
        return
    spans = "; ".join(f"{begin} and {end}" for begin, end in falls)
    raise UsageError(
        f"--task {task}: {when} is not between the audits of {station} where its counters fell"
        f" ({spans}); give --at {falls[-1][1]}. Nothing was added"
    )


def _read(ledger: Path) -> Book:
    from jbclog.maintenance.ledger import read_book

    return read_book(ledger)


def _places(line: Path | None) -> list[Place]:
    from jbclog.config.line import load_line

    loaded = None if line is None else load_line(line)
    return [] if loaded is None else [(loaded.name, one.name) for one in loaded.stations]


def _names(tasks: Path | None) -> Sequence[str] | None:
    if tasks is None:
        return None
    from jbclog.config.tasks_file import load_tasks

    return [one.name for one in load_tasks(tasks)]


def _moment(text: str, now: datetime) -> datetime:
    """Return the time of the maintenance. Raises `UsageError` if it is in the future."""
    from jbclog.cli.runs import moment

    found = moment("--at", text)
    if found is None or found > now:
        raise UsageError(f"--at {text}: is in the future")
    return found


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):
        raise UsageError("--by: the login name is not known; give a name") from None


# -- ledger ----------------------------------------------------------------------------------------


def _keep(fact: Fact, ledger: Path, *, as_json: bool) -> None:
    from jbclog.maintenance.ledger import add

    (kept,) = add(ledger, [fact])
    if as_json:
        echo_json({**asdict(kept), "ledger": str(ledger)})
    else:
        echo(f"{'  '.join(filter(None, _cells(fact)))}  (line {kept.seq} of {ledger})")
    _expect_sound(_read(ledger))


def _list(book: Book, station: str | None, *, as_json: bool) -> None:
    from jbclog.maintenance.fleet_of_ledger import place_of

    place = None if station is None else place_of(station, book)
    facts = sorted(
        (one for one in book.facts if place in (None, (one.line, one.station))),
        key=lambda one: one.time,
    )
    if as_json:
        echo_json(
            {
                "ledger": str(book.path),
                "facts": [asdict(one) for one in facts],
                "wrong": book.sentences,
            }
        )
    else:
        echo_table(COLUMNS, map(_cells, facts))
    _expect_sound(book)


def _cells(fact: Fact) -> tuple[str, ...]:
    where = fact.station if fact.port is None else f"{fact.station} port {fact.port}"
    return fact.time[:16].replace("T", " "), where, fact.task, fact.by, fact.part, fact.text


def _expect_sound(book: Book) -> None:
    if not book.is_sound:
        raise RecordError("; ".join(book.sentences))
