"""`jbclog publish`: copies of sealed runs for every reader of Parquet."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from jbclog.cli import options
from jbclog.cli.options import NO_FOLDER, expect_run, is_folder
from jbclog.cli.output import echo, echo_json, note, reports_errors, run_facts
from jbclog.core.errors import UsageError
from jbclog.core.operating_system import lower_priority
from jbclog.core.outcome import Exit
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from jbclog.app.publish import Outcome
    from jbclog.record.published import Tree

NICENESS: Final = 10


@reports_errors
def publish(
    runs: list[Path] = typer.Argument(..., metavar="RUN", help="Sealed runs.", show_default=False),
    table: Path = typer.Argument(
        ..., metavar="TABLE", help="Folder, network share, or s3://BUCKET/PATH.", show_default=False
    ),
    is_all: bool = typer.Option(
        False, "--all", help="Publish every sealed run in these folders that is missing."
    ),
    check: bool = typer.Option(
        False, "--check", help="Compare with what is published; copy nothing."
    ),
    as_json: bool = options.JSON_PER_RUN,
) -> None:
    """Copy sealed runs into a plant's folder or S3.

    Copies the files of each run, byte for byte, into folders by table, line and month, the manifest
    last. pandas, Polars, DuckDB and PyArrow read them, and so do runs, trend, chart, compare, check
    and export. Publishing a run again changes nothing; after an annotation it copies the
    annotations. Refuses a file that differs from its SHA-256 in the manifest, and a run that is
    there with another manifest. Credentials of S3 come from the environment (AWS_ACCESS_KEY_ID and
    others). Exit code 4: a run was refused, or TABLE cannot be written. Exit code 1 with --check: a
    difference.

    \b
    Example:
      jbclog publish --all runs /data/plant
    """
    from jbclog.record.published import Tree

    _expect_table(table)
    tree = Tree.at(table)
    folders = [*(_sealed_in(runs) if is_all else _runs(runs))]
    if check:
        _check(folders, tree, as_json=as_json)
        return
    from jbclog.app.publish import try_publish

    lower_priority(NICENESS)  # on a busy machine the recorder comes first
    refused = _print((try_publish(folder, tree) for folder in folders), tree, as_json=as_json)
    if refused:
        raise typer.Exit(Exit.RECORD)


def _expect_table(table: Path) -> None:
    """Raise `UsageError` if TABLE is a run, or a folder of runs: its own files would lie among
    those of the table.
    """
    from jbclog.record.manifest import NAME

    if (table / NAME).exists():
        raise UsageError(
            f"{table}: is a run; the last argument is the table: jbclog publish RUN… TABLE."
            " Nothing was published"
        )
    if any(table.glob(f"*/{NAME}")):
        raise UsageError(
            f"{table}: is a folder of runs; give a folder of its own for the table. Nothing was"
            " published"
        )


def _runs(paths: Iterable[Path]) -> Iterator[Path]:
    for path in paths:
        expect_run(path)
        yield path


def _sealed_in(homes: Iterable[Path]) -> Iterator[Path]:
    """Yield the sealed runs in some folders; the others are noted."""
    from jbclog.record.find_runs import SEALED, Unreadable, find
    from jbclog.record.published import is_table

    for home in homes:
        if not is_folder(home):
            raise UsageError(NO_FOLDER.format(home))
        if is_table(home):
            raise UsageError(
                f"{home}: is a table of published runs; give the folder of the runs themselves"
            )
        for found in find(home):
            if isinstance(found, Unreadable):
                note(f"{found.folder}: {found.why}")
            elif found.state != SEALED:
                note(f"{found.folder}: {found.state}, not published")
            else:
                yield found.folder


def _print(outcomes: Iterable[Outcome], tree: Tree, *, as_json: bool) -> int:
    """Print the outcome of each run; return how many were refused."""
    refused = 0
    for outcome in outcomes:
        refused += outcome.refused is not None
        if as_json:
            echo_json({**asdict(outcome), "table": str(tree)})
        elif outcome.refused is not None:
            note(str(outcome))
        else:
            echo(str(outcome))
    return refused


def _check(folders: Iterable[Path], tree: Tree, *, as_json: bool) -> None:
    from jbclog.app.publish import differences

    compared = count = 0
    for folder in folders:
        found = differences(folder, tree)
        compared += 1
        count += len(found)
        if as_json:
            echo_json({**run_facts(folder), "table": str(tree), "differences": found})
        else:
            echo(*found)
    if not as_json:
        result = count_text(count, "difference") if count else "no differences"
        echo(f"{tree}: {result} ({count_text(compared, 'run')})")
    if count:
        raise typer.Exit(1)
