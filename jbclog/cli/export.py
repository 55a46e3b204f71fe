"""`jbclog export`: a run in the format of another program."""

from __future__ import annotations

import os
from collections.abc import Callable
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_run_or_published
from jbclog.cli.output import echo, echo_json, note, reports_errors, run_facts
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.app.export.source import Source

NOT_INSTALLED: Final = "{}: `pip install 'jbclog[export]'` installs what --to {} needs"
MANY_SHEET_ROWS: Final = 1_048_575


class Format(StrEnum):
    """Formats, by the names of --to."""

    CSV = "csv"
    XLSX = "xlsx"
    MF4 = "mf4"
    QDAS = "qdas"


MODULES: Final = {
    Format.CSV: "jbclog.app.export.csv_files",
    Format.XLSX: "jbclog.app.export.workbook",
    Format.MF4: "jbclog.app.export.mdf",
    Format.QDAS: "jbclog.app.export.qdas",
}
"""Modules with a function `write`; the libraries of two of them are the extra `export`."""
FOLDERS: Final = (Format.CSV, Format.QDAS)


@reports_errors
def export(
    run: Path = options.RUN_OR_PUBLISHED,
    to: Format = typer.Option(
        ..., "--to", metavar="csv|xlsx|mf4|qdas", help="Format.", show_default=False
    ),
    out: Path | None = typer.Option(
        None,
        "--out",
        "-o",
        metavar="PATH",
        help="File, or folder for csv and qdas; default: named after the run.",
        show_default=False,
    ),
    table: list[str] = typer.Option(
        [], "--table", metavar="NAME", help="Only this table; repeatable.", show_default=False
    ),
    force: bool = typer.Option(False, "--force", help="Replace an earlier export."),
    unchecked: bool = typer.Option(
        False,
        "--unchecked",
        help="Export a run that is not sealed, or whose check finds something.",
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Export a run for spreadsheets, measurement tools or Q-DAS.

    Writes samples, events, settings, counters, joints and alarms with units and times in UTC: csv,
    a file for each table; xlsx, a workbook; mf4, ASAM MDF 4.10 with a group for each port; qdas,
    the features of joints in the Q-DAS ASCII transfer format. A value that is not known is empty or
    marked invalid, never 0. Each export names the run, its fingerprint and the version. A run that
    is damaged or still open is refused, except with --unchecked.

    \b
    Example:
      jbclog export runs/20261121T013000Z-bench-3-k7qd --to xlsx --out run.xlsx
    """
    expect_run_or_published(run)
    write = _writer(to)
    from jbclog.analysis.run import open_run
    from jbclog.app.export.place import expect_place, written
    from jbclog.app.export.source import Source, expect_whole
    from jbclog.record.published import shown_path, whole_run

    place = _default_place(run, to) if out is None else out
    expect_place(place, run, is_folder=to in FOLDERS, force=force)
    _expect_tables(to, table)
    with whole_run(run) as folder:
        opened = open_run(folder)
        if not unchecked:
            expect_whole(opened, with_report=folder == run)
        source = Source(opened, table, is_checked=not unchecked)
        with written(place) as aside:
            rows = write(source, aside)
    _print(shown_path(run), to, place, rows, is_checked=not unchecked, as_json=as_json)


def _writer(to: Format) -> Callable[[Source, Path], dict[str, int]]:
    """Return the writer of a format. Raises `UsageError` if its library is not installed."""
    try:
        write: Callable[[Source, Path], dict[str, int]] = import_module(MODULES[to]).write
    except ModuleNotFoundError as error:
        raise UsageError(NOT_INSTALLED.format(error, to)) from None
    return write


def _default_place(run: Path, to: Format) -> Path:
    name = Path(os.path.realpath(run)).name
    return Path(f"{name}-{to}" if to in FOLDERS else f"{name}.{to}")


def _expect_tables(to: Format, tables: list[str]) -> None:
    from jbclog.app.export.source import SCHEMA_OF

    known = ["joints"] if to is Format.QDAS else [*SCHEMA_OF]
    unknown = [name for name in tables if name not in known]
    if unknown:
        raise UsageError(f"--table {unknown[0]}: {to} has {', '.join(known)}")


def _print(
    run: Path, to: Format, place: Path, rows: dict[str, int], *, is_checked: bool, as_json: bool
) -> None:
    if as_json:
        echo_json(
            {
                **run_facts(run),
                "to": str(to),
                "out": str(place),
                "rows": rows,
                "checked": is_checked,
            }
        )
        return
    echo(str(place))
    note(", ".join(f"{count} {table}" for table, count in rows.items()))
    if to is Format.XLSX and max(rows.values(), default=0) > MANY_SHEET_ROWS:
        note(
            f"a sheet holds {MANY_SHEET_ROWS} rows; longer tables continue on further sheets, which"
            " the sheet `about` lists"
        )
    if not is_checked:
        note(
            "not checked: the export may come from a run that was changed, damaged or is not whole,"
            " and says so"
        )
