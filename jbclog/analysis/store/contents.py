"""The rows of a sealed run in a store: those of its record, read piece by piece, those computed
from the record, and its row in `runs`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog import __version__
from jbclog.analysis.run import Run
from jbclog.analysis.run_metrics import joints_and_metrics, joints_of, metric_rows_of
from jbclog.analysis.store.identity import Identity
from jbclog.analysis.store.schema import DATA, OWN, RECORD, RUNS, schema_of
from jbclog.analysis.stored_tables import stored_joints, stored_metrics
from jbclog.core.files import Kind, read_regular
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.find_runs import Found
from jbclog.record.folder import recipe_copy
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import manifest_sha256

SMALL_FILES: Final = {
    MANIFEST: Kind.MANIFEST,
    ANNOTATIONS: Kind.ANNOTATIONS,
    "line.toml": Kind.SETTINGS,
}
"""Files that a store keeps byte for byte, besides the copies of the recipes."""
SAME_NAME: Final = (
    "verdict",
    "exit_status",
    "exit_code",
    "operator",
    "order",
    "product",
    "tags",
    "lost",
    "manifest_sha256",
)
LISTS: Final = ("stations", "recipes", "units", "wire_lots", "flux_lots", "tips")

Partition = Mapping[str, str | None]
"""The values of the columns `line` and `month`; None if not known."""


def partition_of(found: Found) -> Partition:
    """Return the line, and the month of the run's start (UTC); None if the manifest has none."""
    started = _time_of(found.started)
    return {"line": found.line, "month": None if started is None else f"{started:%Y-%m}"}


def rows_of(run: Run, table: str) -> Iterator[pa.Table]:
    """Yield the rows of one table of a run; those of its record one row group at a time. Raises
    `RecordError`.
    """
    if table in RECORD:
        return run.groups(table, OWN[table].names)
    return iter([_computed(run, table)])


def _computed(run: Run, table: str) -> pa.Table:
    schema = OWN[table]
    if table in ("joints", "metrics"):
        joints, metrics = _joint_and_metric_rows(run)
        return joints if table == "joints" else pa.Table.from_pylist(metrics, schema=schema)
    return pa.Table.from_pandas(
        run.units() if table == "units" else run.alarms(), schema=schema, preserve_index=False
    )


@lru_cache(maxsize=1)  # `joints` and `metrics` of a run need it, one after the other
def _joint_and_metric_rows(run: Run) -> tuple[pa.Table, list[dict[str, object]]]:
    """Return joints and metrics as stored with the run; if it has neither, compute both in one pass
    over the samples.
    """
    digest = manifest_sha256(run.folder)
    if stored_joints(run.folder, digest) is None and stored_metrics(run.folder, digest) is None:
        joints, metrics, _ = joints_and_metrics(run)
        return joints, metrics
    return joints_of(run), [asdict(row) for row in metric_rows_of(run)]


def stamped(
    pieces: Iterable[pa.Table], table: str, run: str, publication: str, partition: Partition
) -> Iterator[pa.RecordBatch]:
    """Yield the rows with the columns that every table of a store has. Keeps no piece."""
    schema, first = schema_of(table), 0
    for piece in pieces:
        own = [piece[name] for name in OWN[table].names]
        before = [
            _repeated(run, piece),
            _repeated(publication, piece),
            pa.array(range(first, first + piece.num_rows), pa.int64()),
        ]
        after = [_repeated(partition[name], piece) for name in ("line", "month")]
        yield from pa.table([*before, *own, *after], schema=schema).to_batches()
        first += piece.num_rows


def _repeated(text: str | None, piece: pa.Table) -> pa.Array:
    return pa.repeat(pa.scalar(text, pa.utf8()), piece.num_rows)


def run_row(
    found: Found,
    identity: Identity,
    *,
    version: int,
    publications: tuple[str, str],
    publisher: str,
    rows: Mapping[str, int],
    files: Iterable[tuple[str, bytes]],
) -> pa.Table:
    """Return the run's row in `runs`.

    - `publications`: that of its record, then that of its findings
    - `publisher`: name of the publishing host
    - `rows`: number of rows in each table
    - `files`: name and bytes of each small file
    """
    row: dict[str, object] = {name: getattr(found, name) for name in SAME_NAME}
    row |= {name: list(getattr(found, name)) for name in LISTS}
    row |= {f"{table}_rows": rows[table] for table in DATA}
    row |= partition_of(found)
    row |= {
        "run": identity.run,
        "version": version,
        "record": publications[0],
        "findings": publications[1],
        "published": datetime.now(UTC),
        "publisher": publisher,
        "started": _time_of(found.started),
        "ended": _time_of(found.ended),
        "periods": [*found.periods_s.items()],
        "tags": [*found.tags.items()],
        "annotations": list(identity.annotations),
        "rules": identity.rules,
        "jbclog": __version__,
        "files": [{"path": path, "data": data} for path, data in files],
    }
    return pa.Table.from_pylist([row], schema=schema_of(RUNS))


def small_files(run: Run) -> Iterator[tuple[str, bytes]]:
    """Yield name and bytes of each small file that the run has: manifest, annotations, line,
    recipes. Raises OSError.
    """
    folder = run.folder
    paths = {name: (folder / name, kind) for name, kind in SMALL_FILES.items()}
    paths |= {
        f"recipes/{Path(one.file).name}": (recipe_copy(folder, one.file), Kind.SETTINGS)
        for one in run.manifest.recipes
    }
    for name, (path, kind) in paths.items():
        try:
            yield name, read_regular(path, kind)
        except FileNotFoundError:
            continue


def _time_of(text: str | None) -> datetime | None:
    return None if text is None else datetime.fromisoformat(text)
