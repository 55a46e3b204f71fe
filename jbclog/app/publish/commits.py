"""The commits of a publisher. Nothing is atomic across tables, so `runs` comes last, and rows that
it does not name do not count.

Commits to `runs` exclude each other: each records the same application, and the library refuses a
commit if another one recorded it since the table was read. So a publisher reads `runs`, decides,
and commits; if another was first, it reads and decides again. The library does not refuse a
repetition by itself: the publisher must find that the run is there already.

The remains of an interrupted publisher may be removed only after a commit to `runs` that records it
(`fence`): a publisher that was merely slow finds that commit, and does not name rows that are gone.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import chain, islice
from typing import TYPE_CHECKING, Final
from urllib.parse import unquote

import pyarrow as pa

from jbclog.analysis.store.data_files import DataFiles
from jbclog.analysis.store.place import Place, explained, one_line
from jbclog.analysis.store.reader import actions_of, may_have, opened
from jbclog.analysis.store.schema import PARTITIONS, PROPERTY, RUNS, SCHEMA, TABLES, schema_of
from jbclog.core.errors import StoreError

if TYPE_CHECKING:
    from deltalake import CommitProperties, DeltaTable, WriterProperties

APPLICATION: Final = "jbclog.runs"
FENCE: Final = "jbclog.removed."
TRIES: Final = 40
GROUP_ROWS: Final = 32_768
BATCHES: Final = 16  # batches per commit, about half a million rows
LARGEST_PAUSE_S: Final = 0.5
CONFIGURATION: Final = {PROPERTY: str(SCHEMA)}


def create_tables(place: Place) -> None:
    """Create missing tables. Raises `StoreError`, also for a store of a newer jbclog."""
    for name in TABLES:
        if not place.has_table(name):
            _create(place, name)
        opened(place, name)


def _create(place: Place, name: str) -> None:
    from deltalake import DeltaTable

    with explained(place.url):
        DeltaTable.create(
            place.of(name),
            schema_of(name),
            mode="ignore",  # another publisher may be first
            partition_by=list(PARTITIONS),
            name=name,
            configuration=CONFIGURATION,
            storage_options=place.options,
            raise_if_key_not_exists=False,
        )


def append(
    place: Place, name: str, publication: str, rows: Callable[[], Iterator[pa.RecordBatch]]
) -> int:
    """Commit the rows to a table, some batches per commit, because the library may take a whole
    commit into memory; return their number.

    Raises `StoreError`, and whatever the rows raise.
    """
    for _ in range(TRIES):
        counted, done = _Counted(rows()), True
        for first in counted:
            before = counted.rows - first.num_rows
            done = _append(
                place, name, publication, counted, chain([first], islice(counted, BATCHES - 1))
            )
            if not done and before:
                raise StoreError(f"{place}: {name} changed meanwhile; publish again")
            if not done:
                break
        if done:
            return counted.rows
    raise StoreError(f"{place}: {name} changed too often; publish again")


def _append(
    place: Place, name: str, publication: str, counted: _Counted, batches: Iterator[pa.RecordBatch]
) -> bool:
    from deltalake import write_deltalake

    table, reader = opened(place, name), pa.RecordBatchReader.from_batches(schema_of(name), batches)
    done = properties(publication=publication)
    try:
        return committed(
            place,
            lambda: write_deltalake(
                table,
                reader,
                mode="append",
                schema_mode="merge",
                writer_properties=writer(),
                commit_properties=done,
            ),
        )
    except Exception:
        if counted.error is not None:
            raise counted.error from None
        raise


class _Counted(Iterator[pa.RecordBatch]):
    """Counts the rows that pass, and keeps the error of the run that they come from, which the
    library would report as one of the store.
    """

    def __init__(self, batches: Iterator[pa.RecordBatch]) -> None:
        self._batches = batches
        self.rows = 0
        self.error: BaseException | None = None

    def __next__(self) -> pa.RecordBatch:
        try:
            batch = next(self._batches)
        except StopIteration:
            raise
        except BaseException as error:
            self.error = error
            raise
        self.rows += batch.num_rows
        return batch


def commit_run(
    place: Place, publication: str, row: Callable[[DeltaTable], pa.Table | None]
) -> bool:
    """Commit to `runs` the row that `row` returns for the current table; return False if it returns
    None. Raises `StoreError`.
    """
    from deltalake import write_deltalake

    for _ in range(TRIES):
        runs = opened(place, RUNS)
        expect_not_fenced(place, runs, publication)
        chosen = row(runs)
        if chosen is None:
            return False
        done = properties(_turn(runs), publication=publication)
        if committed(
            place,
            lambda runs=runs, chosen=chosen, done=done: write_deltalake(  # type: ignore[misc]  # of this turn of the loop
                runs,
                chosen,
                mode="append",
                schema_mode="merge",
                writer_properties=writer(),
                commit_properties=done,
            ),
        ):
            return True
    raise StoreError(f"{place}: {RUNS} changed too often; publish again")


def fence(place: Place, publications: Callable[[DeltaTable], Iterable[str]]) -> list[str]:
    """Commit to `runs` that the publications which `publications` returns will be removed; return
    them. Raises `StoreError`.
    """
    for _ in range(TRIES):
        runs = opened(place, RUNS)
        chosen = sorted(publications(runs))
        if not chosen:
            return []
        done = properties(_turn(runs), *((f"{FENCE}{one}", 1) for one in chosen))
        if committed(
            place,
            lambda runs=runs, done=done: runs.create_write_transaction(  # type: ignore[misc]  # of this turn of the loop
                [], "append", schema_of(RUNS), partition_by=list(PARTITIONS), commit_properties=done
            ),
        ):
            return chosen
    raise StoreError(f"{place}: {RUNS} changed too often; nothing was removed. Check again")


def expect_not_fenced(place: Place, runs: DeltaTable, publication: str) -> None:
    """Raise `StoreError` if `store check` took this publication for an interrupted one."""
    if runs.transaction_version(f"{FENCE}{publication}") is not None:
        raise StoreError(
            f"{place}: `store check` took this publisher for an interrupted one and removed what it"
            " had written; publish again"
        )


def remove(place: Place, name: str, publication: str) -> None:
    """Remove the rows of a publication from a table; its files stay until `store vacuum`.

    Raises `StoreError`.
    """
    quoted = publication.replace("'", "''")  # names in a store may be foreign
    for _ in range(TRIES):
        table, done = opened(place, name), properties(removed=publication)
        with explained(place.url):  # files that contain the publication are rewritten
            DataFiles(place, name, {}).expect_bounded(
                unquote(file["path"])
                for file in actions_of(table).to_pylist()
                if may_have(file, "publication", publication)
            )
        if committed(
            place,
            lambda table=table, done=done: table.delete(
                f"publication = '{quoted}'", commit_properties=done
            ),  # type: ignore[misc]
        ):
            return
    raise StoreError(f"{place}: {name} changed too often; check again")


def _turn(runs: DeltaTable) -> tuple[str, int]:
    return APPLICATION, runs.version() + 1


def properties(*transactions: tuple[str, int], **metadata: str) -> CommitProperties:
    """Return the properties that a commit records beside its rows."""
    from deltalake import CommitProperties, Transaction

    applications = [Transaction(name, version) for name, version in transactions]
    return CommitProperties(custom_metadata=metadata or None, app_transactions=applications or None)


def writer() -> WriterProperties:
    """Return the writer settings of files, which are those of a run."""
    from deltalake import WriterProperties

    return WriterProperties(compression="ZSTD", max_row_group_size=GROUP_ROWS)


def committed(place: Place, commit: Callable[[], object]) -> bool:
    """Whether the commit was made; False, after a pause, if another came first. Raises
    `StoreError`.
    """
    from deltalake.exceptions import CommitFailedError

    with explained(place.url):
        try:
            commit()
        except CommitFailedError as error:
            if "oncurrent" not in one_line(error) and "onflict" not in one_line(error):
                raise
            time.sleep(random.uniform(0, LARGEST_PAUSE_S))
            return False
    return True
