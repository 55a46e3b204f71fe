"""`jbclog runs`: find runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from jbclog.cli import options
from jbclog.cli.options import NO_FOLDER, is_runs
from jbclog.cli.output import echo_json, echo_table, note, reports_errors
from jbclog.core.errors import UsageError
from jbclog.core.text import shortened

if TYPE_CHECKING:
    from jbclog.record.find_runs import Found, Unreadable

# characters of metadata, which have at most 200; --json has all
MOST_TEXT: Final = 300
WIDEST: Final = 30  # widest column on a terminal, in characters
HEADS: Final = (
    "started",
    "line",
    "recipe",
    "operator",
    "order",
    "product",
    "units",
    "verdict",
    "state",
    "run",
)
NOTHING: Final = "-"
# the values of `Verdict` (analysis/verdict/verdict.py), which is slow to import
VERDICTS: Final = ("ACCEPT", "ACCEPT WITH DEVIATIONS", "REJECT", "INCONCLUSIVE", "NOT JUDGED")
STATES: Final = ("running", "crashed", "ended", "cut short", "ended with error", "recovered")


@reports_errors
def runs(
    folder: Path = options.RUNS_OR_TABLE,
    operator: str | None = typer.Option(None, metavar="NAME", help="Operator."),
    order: str | None = options.ORDER,
    product: str | None = options.PRODUCT,
    unit: str | None = typer.Option(None, metavar="SERIAL", help="Serial of a unit."),
    wire_lot: str | None = typer.Option(None, metavar="LOT", help="Lot of the solder wire."),
    flux_lot: str | None = typer.Option(None, metavar="LOT", help="Lot of the flux."),
    tip: str | None = typer.Option(None, metavar="ID", help="Tip."),
    tag: list[str] = typer.Option(
        [], metavar="NAME=VALUE", help="Tag stored with the run; repeatable."
    ),
    recipe: str | None = options.RECIPE_NAME,
    line: str | None = options.LINE_NAME,
    station: str | None = typer.Option(None, metavar="NAME", help="Station name."),
    verdict: str | None = typer.Option(
        None, metavar="VERDICT", help="Verdict: ACCEPT, REJECT, ..."
    ),
    state: str | None = typer.Option(
        None,
        metavar="STATE",
        help="running, crashed, ended, cut short, ended with error, recovered.",
    ),
    since: str | None = typer.Option(
        None, metavar="TIME", help="Earliest start: 2026-11-21 or 2026-11-21T08:00, UTC."
    ),
    until: str | None = options.UNTIL,
    as_json: bool = options.JSON_PER_RUN,
) -> None:
    """Find runs by operator, order, unit, time, verdict and more.

    The state shows how a run ended, whatever its verdict: ended (as planned), cut short (by a
    signal before its planned end), ended with error (a station, the record or a safe state),
    recovered (after a crash).

    A text must match completely; `*` matches any characters. Finds serials read during a run once
    it is sealed.

    \b
    Example:
      jbclog runs runs --order "881*" --since 2026-11-01 --verdict REJECT
    """
    from jbclog.record.find_runs import Filter
    from jbclog.record.published import find_in, shown_path

    if not is_runs(folder):
        raise UsageError(NO_FOLDER.format(folder))
    _expect_word("--verdict", verdict and verdict.upper(), VERDICTS)
    _expect_word("--state", state, STATES)
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
    those = find_in(folder, wanted)
    _print(those, shown_path(folder), unit=unit, is_sought=wanted != Filter(), as_json=as_json)


def _expect_word(
    option: str, text: str | None, words: Sequence[str], more: Sequence[str] = ()
) -> None:
    """Raise `UsageError` for an unknown word: an empty result would look like a good one."""
    if text is not None and "*" not in text and text not in (*words, *more):
        raise UsageError(f"{option} {text}: must be one of {', '.join(words)}")


def moment(option: str, text: str | None, *, is_end: bool = False) -> datetime | None:
    """Return a day or time, UTC if without a zone; with `is_end` a day's end. Raises
    `UsageError`.
    """
    if text is None:
        return None
    try:
        found = datetime.fromisoformat(text.strip())
        found = found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
        return (
            found + timedelta(days=1)
            if is_end and len(text.strip()) <= len("2026-11-21")
            else found
        )
    except (ValueError, OverflowError):
        raise UsageError(
            f"{option} {text}: give a day such as 2026-11-21, or a time such as 2026-11-21T08:00"
        ) from None


def _print(
    those: Iterable[Found | Unreadable],
    folder: Path,
    *,
    unit: str | None,
    is_sought: bool,
    as_json: bool,
) -> None:
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
            echo_json(facts(one))
    if not as_json and found:
        echo_table(HEADS, [cells(one, unit) for one in found], cut=WIDEST)
    if not found:
        note(f"{folder}: no run matches" if is_sought else f"{folder}: no runs")


def facts(run: Found) -> dict[str, object]:
    """Return a run as JSON data; `run` is its folder."""
    known = {
        one.name: getattr(run, one.name)
        for one in fields(run)
        if one.name not in ("folder", "run", "manifest_sha256")
    }
    return {"run": str(run.folder), **known, "shown_state": run.shown_state}


def cells(run: Found, unit: str | None = None) -> tuple[str, ...]:
    """Return a run as a row of the table, with the unit searched for."""
    started = (run.started or NOTHING)[:16].replace("T", " ")
    texts = (
        run.line,
        ", ".join(run.recipes),
        run.operator,
        run.order,
        run.product,
        several(run.units, unit),
        run.verdict,
    )
    return (
        started,
        *(shortened(text or NOTHING, MOST_TEXT) for text in texts),
        run.shown_state,
        str(run.folder),
    )


def several(texts: Sequence[str], sought: str | None = None) -> str:
    """Return the text searched for, or the first, and the number of others."""
    shown = sought if sought in texts else next(iter(texts), "")
    return f"{shown} +{len(texts) - 1}" if len(texts) > 1 else str(shown)
