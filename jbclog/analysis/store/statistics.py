"""Statistics of a column over the runs of a store, for each run, line, station, port or tip.

`partial` computes a partial result (`Part`) from some files, or a part of a large one; `Part.add`
merges two; `finish` makes the table. Partial results may be computed on any computer and merged in
any order: the answer is the same to the last digit (`jbclog.analysis.fleet.moments`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.types as pt

from jbclog.analysis.fleet.engine import MUCH_ROWS, engine_of
from jbclog.analysis.fleet.moments import QUANTILE_ERROR, Moments, moments_of
from jbclog.analysis.run_metrics import joints_of
from jbclog.analysis.store.parts import Files, expect_all, parts_of
from jbclog.analysis.store.place import Place
from jbclog.analysis.store.reader import Published, Store
from jbclog.analysis.store.run import StoredRun
from jbclog.analysis.store.schema import OWN
from jbclog.analysis.trend import tips_of
from jbclog.analysis.verdict import RULES
from jbclog.core.errors import UsageError
from jbclog.core.text import shortened
from jbclog.record.find_runs import Found

TABLES: Final = ("samples", "joints")
BY: Final = ("run", "line", "station", "port", "tip")
PERCENTS: Final = (5, 50, 95)
Key = tuple[str | int | None, ...]


@dataclass(frozen=True, slots=True)
class Owner:
    """Facts about a run that are sent with its rows. `Found` is not sent: its serials can be
    thousands.
    """

    run: str
    line: str | None
    tips: tuple[str, ...]

    @classmethod
    def of(cls, found: Found) -> Owner:
        return cls(found.folder.name, found.line, found.tips)


def key_of(owner: Owner, by: Sequence[str], station: str, port: int) -> Key:
    """Return the group of a row. A tip that the user did not name is None."""
    facts: dict[str, str | int | None] = {
        "run": owner.run,
        "line": owner.line,
        "station": station,
        "port": port,
    }
    if "tip" in by:
        facts["tip"] = ", ".join(tips_of(owner.tips, station, port)) or None
    return tuple(facts[name] for name in by)


class Rows(Protocol):
    """Rows that are read by the process to which this object is sent."""

    def pieces(self, columns: Sequence[str]) -> Iterator[pa.Table]:
        """Yield these columns of the rows. Raises `RecordError`."""
        ...


@dataclass(frozen=True, slots=True)
class JointsAnew:
    """Joints of a run that was published with other rules, computed again from its samples."""

    place: Place
    entry: Published

    def pieces(self, columns: Sequence[str]) -> Iterator[pa.Table]:
        """Yield these columns of the joints. Raises `RecordError`."""
        joints = joints_of(StoredRun(Store(self.place), self.entry))
        named = joints.append_column(
            "publication", pa.repeat(pa.scalar(self.entry.findings, pa.utf8()), joints.num_rows)
        )
        yield named.select(list(columns))


@dataclass(frozen=True, slots=True)
class Task:
    """A column of some rows, the facts that group its values (`by`), and the run of each
    publication.
    """

    rows: Rows
    column: str
    by: tuple[str, ...]
    owners: Mapping[str, Owner]


@dataclass(slots=True)
class Part:
    """A partial result: number of rows of each publication, and statistics of each group."""

    counts: Counter[str] = field(default_factory=Counter)
    groups: dict[Key, Moments] = field(default_factory=dict)

    def add(self, other: Part) -> None:
        """Merge another partial result into this one."""
        self.counts.update(other.counts)
        for key, moments in other.groups.items():
            self.groups.setdefault(key, Moments()).add(moments)


def partial(task: Task) -> Part:
    """Return the statistics of some rows; holds at most 32 768 of them. Raises `RecordError`."""
    part = Part()
    for piece in task.rows.pieces(["publication", "station", "port", task.column]):
        for start in range(0, piece.num_rows, 32_768):
            _add(part, task, piece.slice(start, 32_768))
    return part


def _add(part: Part, task: Task, piece: pa.Table) -> None:
    """Add rows, equal ones together: readings are whole numbers, so few differ."""
    names = ["publication", "station", "port", task.column]
    equal = piece.group_by(names, use_threads=False).aggregate([([], "count_all")])
    publications, stations, ports = (equal[name].to_pylist() for name in names[:3])
    counts = equal["count_all"].to_numpy()
    keys: dict[Key, int] = {}
    groups = np.empty(len(counts), np.int64)
    for row, place in enumerate(zip(publications, stations, ports, strict=True)):
        key = key_of(task.owners[place[0]], task.by, place[1], place[2])
        groups[row] = keys.setdefault(key, len(keys))
        part.counts[place[0]] += int(counts[row])
    values = equal[task.column].cast(pa.float64()).to_numpy()
    part.add(
        Part(groups=dict(zip(keys, moments_of(values, counts, groups, len(keys)), strict=True)))
    )


def statistics(
    store: Store,
    runs: Sequence[Published],
    table: str,
    column: str,
    by: Sequence[str],
    scheduler: str | None = None,
) -> pd.DataFrame:
    """Return a row for each group, as `StoredRuns.statistics` does."""
    _expect_known(table, column, by)
    read = [one for one in runs if table != "joints" or one.identity.rules == RULES]
    others = [one for one in runs if table == "joints" and one.identity.rules != RULES]
    is_much = sum(one.rows[table] for one in read) >= MUCH_ROWS
    tasks = [*_tasks(parts_of(store, table, read), read, column, tuple(by))]
    tasks += [
        Task(JointsAnew(store.place, one), column, tuple(by), {one.findings: Owner.of(one.found)})
        for one in others
    ]
    whole = Part()
    for part in engine_of(scheduler, is_much=is_much).run(partial, tasks):
        whole.add(part)
    expect_all(store.place, table, read, whole.counts)
    return finish(whole, by)


def _tasks(
    parts: Iterable[Files], runs: Iterable[Published], column: str, by: tuple[str, ...]
) -> Iterator[Task]:
    owners = {one.publication(table): Owner.of(one.found) for one in runs for table in TABLES}
    for part in parts:
        yield Task(part, column, by, {name: owners[name] for name in part.publications})


def finish(whole: Part, by: Sequence[str]) -> pd.DataFrame:
    """Return the merged result as a table, ordered by group."""
    rows = [
        [
            *key,
            one.n,
            one.unknown,
            one.mean,
            one.sd,
            one.least,
            one.greatest,
            *one.quantiles(PERCENTS),
        ]
        for key, one in sorted(
            whole.groups.items(), key=lambda item: [(value is None, value) for value in item[0]]
        )
    ]
    figures = ["mean", "sd", "min", "max", *(f"p{percent:02}" for percent in PERCENTS)]
    frame = pd.DataFrame(rows, columns=[*by, "n", "unknown", *figures])
    kinds = {name: "int64" if name == "port" else "str" for name in by}
    frame = frame.astype(
        kinds | {"n": "int64", "unknown": "int64"} | dict.fromkeys(figures, "Float64")
    )
    frame.attrs["quantile_error"] = QUANTILE_ERROR
    return frame


def _expect_known(table: str, column: str, by: Sequence[str]) -> None:
    if table not in TABLES:
        raise UsageError(
            f"there are statistics of {' and '.join(TABLES)}, not of {shortened(table, 64)!r}"
        )
    numbers = [
        one.name for one in OWN[table] if pt.is_integer(one.type) or pt.is_floating(one.type)
    ]
    if column not in numbers:
        raise UsageError(
            f"{table} has no numbers {shortened(column, 64)!r}; it has {', '.join(numbers)}"
        )
    unknown = [name for name in by if name not in BY]
    if unknown or not by or len({*by}) != len(by):
        raise UsageError(
            f"groups are some of {', '.join(BY)}, each once (got {', '.join(by) or 'none'})"
        )
