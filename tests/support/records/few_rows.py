"""Rows that are known by their number: whoever reads them back can tell exactly what is there and
what is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from jbclog.core.rows import (
    COLUMN,
    SAMPLE_COLUMNS,
    CounterRow,
    EventRow,
    SampleRow,
    SettingRow,
    Severity,
    StationFacts,
)
from jbclog.record.chains import breaks
from jbclog.record.folder import create_run
from jbclog.record.journal_reader import Journal
from jbclog.record.manifest import Manifest, write_manifest
from jbclog.record.parts import part_paths, row_groups
from jbclog.record.run_journal import RunJournal
from jbclog.record.segments import RESERVE
from support.product import open_store

T0 = 1_790_000_000_000_000
EVENT_EVERY = 7


def sample(number: int, station: str = "a", port: int = 1) -> SampleRow:
    row: SampleRow = [None] * len(SAMPLE_COLUMNS)
    row[COLUMN["time"]], row[COLUMN["tick"]] = T0 + number * 100_000, number
    row[COLUMN["station"]], row[COLUMN["port"]], row[COLUMN["quality"]] = station, port, "ok"
    row[COLUMN["temperature_c"]] = 300 + number % 97
    if number % 5 == 0:
        row[COLUMN["alarm_high"]], row[COLUMN["alarm_low"]] = number % 10 == 0, False
    if number % 11 == 0:
        row[COLUMN["quality"]], row[COLUMN["reasons"]] = (
            "timeout",
            "power_permille=timeout;alarm_high=timeout;alarm_low=timeout",
        )
        row[COLUMN["alarm_high"]] = row[COLUMN["alarm_low"]] = None
    else:
        row[COLUMN["power_permille"]] = number % 1000
    return row


def event(number: int) -> EventRow:
    return EventRow(
        T0 + number,
        "test.event",
        Severity.INFO,
        f"event {number} – 350 °C",
        "a",
        1,
        None,
        number,
        1.5 * number,
    )


def setting(number: int) -> SettingRow:
    return SettingRow(
        T0 + number,
        "a",
        1,
        "T210",
        f"setting_{number}",
        "°C",
        "350",
        None,
        "350",
        None,
        "unchanged",
    )


def counter(number: int) -> CounterRow:
    return CounterRow(T0 + number, "a", 1, "work_h", float(number), "h", f"{number:05d}")


def facts(due: int = 0) -> StationFacts:
    return StationFacts(
        "a", "a.pty", "dde", ports=[1], tool_names={1: "T210"}, outcome="running", due={}
    )


def hand_over(store: RunJournal, numbers: Iterable[int]) -> None:
    """The samples of these numbers, an event at each seventh, a counter at each hundredth."""
    for number in numbers:
        store.sample(sample(number))
        if number % EVENT_EVERY == 0:
            store.event(event(number))
        if number % 100 == 0:
            store.counter(counter(number))


def begun(out: Path, **more: object) -> RunJournal:
    """A started store in a new folder, without hourly sealing."""
    store = open_store(create_run(out, "bench", T0 / 1e6), seal_every_s=None, **more)
    store.start()
    return store


def abandoned(out: Path, commits: int = 3, rows: int = 50) -> Path:
    """The folder of a run whose recorder vanished after `commits` commits of `rows` samples
    each.
    """
    store = begun(out)
    # on a busy machine one of the thread's own commits would come in between
    _end_thread(store)
    store.setting(setting(0))
    store.facts(facts())
    for commit in range(commits):
        hand_over(store, range(commit * rows, (commit + 1) * rows))
        store.commit_now()
    vanish(store)
    return store.folder


def closed(out: Path, rows: int, *stations: StationFacts) -> Path:
    """A run that its recorder has ended, and not sealed yet."""
    store = begun(out)
    for one in stations:
        store.facts(one)
    hand_over(store, range(rows))
    store.close()
    store.release()
    write_manifest(
        store.folder,
        Manifest(store.folder.name, exit_status="success", exit_code=0, verdict="ACCEPT"),
    )
    return store.folder


def vanish(store: RunJournal) -> None:
    """Leave the folder as a kill would: nothing closed, the lock free."""
    _end_thread(store)
    reserve = (store.folder / RESERVE).read_bytes()
    store._writer.close()
    store.release()
    (store.folder / RESERVE).write_bytes(reserve)


def _end_thread(store: RunJournal) -> None:
    """From here on it commits on request alone."""
    store._ending = True
    store._wake.set()
    store._thread.join()


def at_risk_s(folder: Path) -> float:
    """For how long rows of an abandoned run may have waited for their commit: a second, or as long
    as a busy machine had them wait here; to be asked before it is recovered.
    """
    with Journal(folder) as journal:
        return float(str(journal.notes["risk_s"]))


def table(folder: Path, name: str) -> pa.Table:
    """The sealed rows of a table."""
    return pa.concat_tables(list(row_groups(folder, name)))


def sealed_numbers(folder: Path) -> list[int]:
    """The numbers of the samples that are sealed, each of which is exactly what was handed over;
    the record has numbered them as they came.
    """
    numbers = []
    last = -1
    for group in row_groups(folder, "samples"):
        place = group.schema.get_field_index("time")
        plain = group.set_column(place, "time", group["time"].cast(pa.int64()))
        for row in plain.to_pylist():
            run, seq, *values = row.values()
            assert values == sample(row["tick"], row["station"], row["port"]), row
            assert run == folder.name
            assert seq > last
            last = seq
            numbers.append(row["tick"])
    return numbers


def sealed_events(folder: Path) -> list[int]:
    """The numbers of the events that are sealed; their chain holds."""
    rows = []
    for group in row_groups(folder, "events"):
        for name in ("time", "earliest"):
            group = group.set_column(
                group.schema.get_field_index(name), name, group[name].cast(pa.int64())
            )
        rows += group.to_pylist()
    assert list(breaks(folder.name, rows)) == []
    return [row["code"] for row in rows if row["kind"] == "test.event"]


def with_cell(table: pa.Table, row: int, column: str, value: object) -> pa.Table:
    """The table with another value in one cell."""
    values = table[column].to_pylist()
    values[row] = value
    place = table.schema.get_field_index(column)
    return table.set_column(
        place, table.schema.field(column), pa.array(values, table.schema.field(column).type)
    )


def rewritten(folder: Path, table: str, change: Callable[[pa.Table], pa.Table]) -> None:
    """Change the rows of a sealed table; the file keeps its metadata."""
    (path,) = part_paths(folder, table)
    metadata = pq.read_metadata(path).metadata
    with pq.ParquetFile(path) as file:
        changed = change(file.read())
    pq.write_table(
        changed.replace_schema_metadata({**(changed.schema.metadata or {}), **metadata}), path
    )
