"""`jbclog runs`: find runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from jbclog.cli import options
from jbclog.cli.options import NO_FOLDER, is_runs
from jbclog.cli.output import echo_json, echo_table, note, reports_errors, run_facts
from jbclog.cli.times import (
    NOTHING,
    are_local,
    head_of_times,
    range_text,
    shown_moment,
    typed_moment,
)
from jbclog.core.errors import UsageError
from jbclog.core.text import shortened

if TYPE_CHECKING:
    from jbclog.record.find_runs import Found, Unreadable

# characters of metadata, which have at most 200; --json has all
MOST_TEXT: Final = 300
WIDEST: Final = 30  # widest column on a terminal, in characters
HEADS: Final = (
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
        None, metavar="TIME", help="Earliest start: 2026-11-21 or 2026-11-21T08:00."
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

    On a terminal, times are local and have their zone, and TIME without a zone is local. In a pipe,
    a file and with --json they are UTC.

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
    is_local = are_local(as_json=as_json)
    begin = typed_moment("--since", since, is_local=is_local)
    end = typed_moment("--until", until, is_local=is_local, is_end=True)
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
        since=begin,
        until=end,
    )
    those = find_in(folder, wanted)
    empty = "no runs" if wanted == Filter() else f"no run matches{range_text(begin, end)}"
    _print(those, f"{shown_path(folder)}: {empty}", unit=unit, as_json=as_json)


def _expect_word(
    option: str, text: str | None, words: Sequence[str], more: Sequence[str] = ()
) -> None:
    """Raise `UsageError` for an unknown word: an empty result would look like a good one."""
    if text is not None and "*" not in text and text not in (*words, *more):
        raise UsageError(f"{option} {text}: must be one of {', '.join(words)}")


def _print(
    those: Iterable[Found | Unreadable],
    empty: str,
    *,
    unit: str | None,
    as_json: bool,
) -> None:
    """Print the runs, or the text `empty` for none."""
    from jbclog.record.find_runs import Found

    found: list[Found] = []
    for one in those:
        if not isinstance(one, Found):
            note(f"{one.folder}: {one.why}")
            continue
        if one.changed:
            note(f"{one.folder}: its manifest {one.changed}")
        if one.clock_wrong:
            note(f"{one.folder}: {one.clock_wrong}")
        found.append(one)
        if as_json:
            echo_json(facts(one))
    if not as_json and found:
        is_local = are_local(as_json=as_json)
        heads = (head_of_times("start", is_local=is_local), *HEADS)
        echo_table(heads, [cells(one, unit, is_local=is_local) for one in found], cut=WIDEST)
    if not found:
        note(empty)


def facts(run: Found) -> dict[str, object]:
    """Return a run as JSON data."""
    known = {
        one.name: getattr(run, one.name)
        for one in fields(run)
        if one.name not in ("folder", "run", "manifest_sha256", "clock_steps")
    }
    more = {"shown_state": run.shown_state, "clock_wrong": run.clock_wrong}
    return {**run_facts(run.folder), **known, **more}


def cells(run: Found, unit: str | None = None, *, is_local: bool = False) -> tuple[str, ...]:
    """Return a run as a row of the table, with the unit searched for."""
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
        shown_moment(run.start, is_local=is_local),
        *(shortened(text or NOTHING, MOST_TEXT) for text in texts),
        run.shown_state,
        str(run.folder),
    )


def several(texts: Sequence[str], sought: str | None = None) -> str:
    """Return the text searched for, or the first, and the number of others."""
    shown = sought if sought in texts else next(iter(texts), "")
    return f"{shown} +{len(texts) - 1}" if len(texts) > 1 else str(shown)
