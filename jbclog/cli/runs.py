"""`jbclog runs`: find runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from jbclog.cli import options
from jbclog.cli.options import is_folder
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.core.errors import UsageError
from jbclog.core.text import clean

if TYPE_CHECKING:
    from jbclog.record.find_runs import Found, Unreadable

WIDEST: Final = 30  # cells of a column but the last; --json has all of it
HEADS: Final = ("started", "line", "recipe", "operator", "order", "product", "units", "verdict", "state", "run")
NOTHING: Final = "-"
VERDICTS: Final = ("ACCEPT", "ACCEPT WITH DEVIATIONS", "REJECT", "INCONCLUSIVE", "NOT JUDGED")  # judge.Verdict, which loads slowly
STATES: Final = ("running", "crashed", "ended", "cut short", "ended with error", "recovered")
OLD_STATES: Final = ("sealed", "success", "aborted", "failed", "lost")  # of the manifest, which release 1 showed


@ends_with_errors_told
def runs(
    folder: Path = typer.Argument(Path("runs"), metavar="DIR", help="The folder that the runs are in."),
    operator: str | None = typer.Option(None, metavar="NAME", help="Who ran it."),
    order: str | None = typer.Option(None, metavar="NUMBER", help="The work order."),
    product: str | None = typer.Option(None, metavar="NAME", help="What was made."),
    unit: str | None = typer.Option(None, metavar="SERIAL", help="A unit: named, read during the run, or added later."),
    wire_lot: str | None = typer.Option(None, metavar="LOT", help="The solder wire's lot."),
    flux_lot: str | None = typer.Option(None, metavar="LOT", help="The flux's lot."),
    tip: str | None = typer.Option(None, metavar="ID", help="A tip."),
    tag: list[str] = typer.Option([], metavar="NAME=VALUE", help="Anything else that was kept with the run; may be repeated."),
    recipe: str | None = typer.Option(None, metavar="NAME[@REVISION]", help="The recipe by its name."),
    line: str | None = typer.Option(None, metavar="NAME", help="The line by its name."),
    station: str | None = typer.Option(None, metavar="NAME", help="A station that took part."),
    verdict: str | None = typer.Option(None, metavar="VERDICT", help="ACCEPT, REJECT, ..."),
    state: str | None = typer.Option(
        None, metavar="STATE", help="running, crashed, ended, cut short, ended with error, or recovered."
    ),
    since: str | None = typer.Option(None, metavar="TIME", help="Begun then or later: 2026-11-21 or 2026-11-21T08:00, UTC."),
    until: str | None = typer.Option(None, metavar="TIME", help="Begun before then; a day is included."),
    as_json: bool = typer.Option(False, "--json", help="A JSON object for each run, a line each."),
) -> None:
    """Find runs by operator, order, unit, time, verdict and more.

    The state is how a run ended, whatever its verdict: ended (as asked, or by itself), cut short (by a signal before its stated
    end), ended with error (a station, the record or a safe state), recovered (after a crash).

    A text must match whole; `*` matches any characters. Serials read during a run are found once it is sealed.

    \b
    Example:
      jbclog runs runs --order "881*" --since 2026-11-01 --verdict REJECT
    """
    from jbclog.record.find_runs import Filter, find

    if not is_folder(folder):
        raise UsageError(f"{folder}: there is no such folder; runs are in `runs/`, or where --out put them")
    _expect_word("--verdict", verdict and verdict.upper(), VERDICTS)
    _expect_word("--state", state, STATES, OLD_STATES)
    wanted = Filter(
        operator=operator,
        order=order,
        product=product,
        unit=unit,
        wire_lot=wire_lot,
        flux_lot=flux_lot,
        tip=tip,
        tags=options.tags(tag),
        recipe=recipe,
        line=line,
        station=station,
        verdict=verdict,
        state=state,
        since=moment("--since", since),
        until=moment("--until", until, is_end=True),
    )
    _tell(find(folder, wanted), folder, unit=unit, is_sought=wanted != Filter(), as_json=as_json)


def _expect_word(option: str, text: str | None, words: Sequence[str], more: Sequence[str] = ()) -> None:
    """Raises `UsageError`: that no run has a verdict which does not exist would be read as if all were well."""
    if text is not None and "*" not in text and text not in (*words, *more):
        raise UsageError(f"{option} {text}: there are {', '.join(words)}")


def moment(option: str, text: str | None, *, is_end: bool = False) -> datetime | None:
    """A day or a time of day, UTC where no zone is named; with `is_end` a day means its end. Raises `UsageError`."""
    if text is None:
        return None
    try:
        found = datetime.fromisoformat(text.strip())
        found = found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
        return found + timedelta(days=1) if is_end and len(text.strip()) <= len("2026-11-21") else found
    except (ValueError, OverflowError):
        raise UsageError(f"{option} {text}: give a day such as 2026-11-21, or a time such as 2026-11-21T08:00") from None


def _tell(those: Iterable[Found | Unreadable], folder: Path, *, unit: str | None, is_sought: bool, as_json: bool) -> None:
    from jbclog.record.find_runs import Found

    found: list[Found] = []
    for one in those:
        if not isinstance(one, Found):
            note(f"{one.folder}: {one.why}")
            continue
        if one.changed:
            note(f"{one.folder}: its manifest {one.changed}")
        found.append(one)
        if as_json:
            tell_json(facts(one))
    if not as_json and found:
        for line in table([cells(one, unit) for one in found]):
            tell(line)
    if not found:
        note(f"{folder}: no run fits" if is_sought else f"{folder}: no runs")


def facts(run: Found) -> dict[str, object]:
    """A run as a JSON object; its folder is its key `run`."""
    told = asdict(run)
    del told["folder"]
    return {"run": str(run.folder), **told, "shown_state": run.shown_state}


def cells(run: Found, unit: str | None = None) -> tuple[str, ...]:
    """A run as a row of the table; of its units the one that was sought."""
    started = (run.started or NOTHING)[:16].replace("T", " ")
    texts = (run.line, ", ".join(run.recipes), run.operator, run.order, run.product, several(run.units, unit), run.verdict)
    return (started, *(text or NOTHING for text in texts), run.shown_state, str(run.folder))


def several(texts: Sequence[str], sought: str | None = None) -> str:
    """The one that was sought, or the first, and how many more."""
    shown = sought if sought in texts else next(iter(texts), "")
    return f"{shown} +{len(texts) - 1}" if len(texts) > 1 else str(shown)


def table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Rows under their heads, in columns; what is too wide is cut."""
    from rich.cells import cell_len, set_cell_size

    shown = [HEADS, *(tuple(_cut(clean(cell)) for cell in row[:-1]) + row[-1:] for row in rows)]
    widths = [max(cell_len(row[place]) for row in shown) for place in range(len(HEADS) - 1)]
    return ["  ".join((*map(set_cell_size, row[:-1], widths), row[-1])) for row in shown]


def _cut(text: str) -> str:
    from rich.cells import cell_len, set_cell_size

    return text if cell_len(text) <= WIDEST else set_cell_size(text, WIDEST - 1) + "…"
