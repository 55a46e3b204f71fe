"""Maintains a store: finds damage, removes leftovers of interrupted publishers, joins small files,
deletes files that no version needs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final
from urllib.parse import unquote

import pyarrow.compute as pc

from jbclog.analysis.store.place import Place, expect_library, explained
from jbclog.analysis.store.reader import Published, Store, actions_of, opened
from jbclog.analysis.store.rows import chosen_rows
from jbclog.analysis.store.schema import DATA, RUNS, TABLES
from jbclog.app.publish.commits import committed, properties, writer
from jbclog.app.publish.lease import FOLDER, VALID, leases, live
from jbclog.app.publish.leftovers import swept
from jbclog.app.publish.safe_place import PROBE
from jbclog.core.errors import RecordError, StoreError, UsageError
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from deltalake import DeltaTable

SWEPT_AFTER: Final = timedelta(hours=24)
LEAST_DAYS: Final = 7
MOST_NAMED: Final = 20  # files or runs with a finding of their own


@dataclass(slots=True)
class Checked:
    """Result of a check: damage; leftovers of interrupted publishers; what was removed; other
    notes.
    """

    runs: int = 0
    findings: list[str] = field(default_factory=list)
    leftovers: list[str] = field(default_factory=list)
    removed: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def check(place: Place, older_than: timedelta = SWEPT_AFTER) -> Checked:
    """Check a store; remove leftovers of interrupted publishers that are older than `older_than`.

    Removes nothing beside a publisher that may be working. Raises `RecordError` if the store cannot
    be read.
    """
    expect_library()
    store, found = Store(place), Checked()
    entries = store.every_version()
    found.runs = len({one.identity.run for one in entries})
    left: dict[str, set[str]] = {}
    for table in DATA:
        try:
            strange = [*_strange(store, table)]
            found.findings += strange
            if strange:
                continue
            counts, written = _counted(store, table), _written(store, table)
            found.findings += _damage(store, table, entries, counts)
        except RecordError as error:
            found.findings.append(str(error))
            continue
        for publication in counts.keys() - {one.publication(table) for one in entries}:
            _sort_out(
                found,
                left,
                table,
                publication,
                counts[publication],
                written.get(publication),
                older_than,
            )
    found.findings += _twice(entries)
    _sweep(place, found, left)
    return found


def _sort_out(
    found: Checked,
    left: dict[str, set[str]],
    table: str,
    publication: str,
    rows: int,
    written: datetime | None,
    older_than: timedelta,
) -> None:
    text = f"{count_text(rows, 'row')} of an interrupted publisher ({publication}) in {table}"
    if written is not None and datetime.now(UTC) - written < older_than:
        found.leftovers.append(f"{text}, younger than {_hours(older_than)}")
    else:
        left.setdefault(publication, set()).add(table)
        found.leftovers.append(text)


def _sweep(place: Place, found: Checked, left: Mapping[str, set[str]]) -> None:
    """Remove leftovers, dead leases and old trials, unless a publisher is at work."""
    held = [*leases(place)]  # once: one that starts behind this keeps its own
    at_work = [one for one in held if one.is_live]
    if at_work:
        found.notes += [f"a publisher is at work, so nothing was removed: {one}" for one in at_work]
        return
    found.removed += [
        f"{table}: rows of {publication}" for table, publication in swept(place, left)
    ]
    trials = _trials(place)
    young = sorted(name for name, age in trials.items() if age < VALID)
    found.notes += [f"{name}: a trial of the place, younger than {_hours(VALID)}" for name in young]
    old = sorted(trials.keys() - {*young})
    for folder in [*(f"{FOLDER}/{one.publisher}" for one in held), *old]:
        place.remove(folder)
        found.removed.append(folder)


def _trials(place: Place) -> dict[str, timedelta]:
    """Return the age of each trial of the place. A publisher that makes one may have no lease yet,
    so only its files show that it is at work.
    """
    now = datetime.now(UTC)
    ages: dict[str, timedelta] = {}
    for file in place.listed(""):
        name = file.name.partition("/")[0]
        if name.startswith(PROBE):
            age = now - (file.written or now)
            ages[name] = min(age, ages.get(name, age))
    return ages


def _counted(store: Store, table: str) -> Counter[str]:
    """Return the number of rows of each publication, from statistics where a file has one only."""
    counts: Counter[str] = Counter()
    files = actions_of(store.table(table)).to_pylist()
    mixed = {unquote(file["path"]) for file in files if _only(file) is None}
    for file in files:
        counts[_only(file) or ""] += file["num_records"] or 0
    del counts[""]
    if mixed:
        with explained(store.place.url):
            schema = store.dataset(table).schema
            for fragment in store.dataset(table).get_fragments():
                if unquote(fragment.path) in mixed:
                    for piece in chosen_rows(fragment, ["publication"], None, schema):
                        names = pc.value_counts(piece["publication"]).to_pylist()
                        counts.update({one["values"]: one["counts"] for one in names})
    return counts


def _strange(store: Store, table: str) -> Iterator[str]:
    """Yield a sentence for each file that no publisher wrote so. Missing files are found later."""
    looks, named = store.data_files(table), 0
    for path, _ in _files(store.table(table)):
        try:
            looks.expect_bounded([path])
        except FileNotFoundError:
            continue
        except StoreError as error:
            named += 1
            if named <= MOST_NAMED:
                yield str(error)
    if named > MOST_NAMED:
        yield f"{table}: and {named - MOST_NAMED} more such files"


def _only(file: Mapping[str, object]) -> str | None:
    """Return the publication of a file; None if it may have several."""
    least = file.get("min.publication")
    return str(least) if least is not None and least == file.get("max.publication") else None


def _written(store: Store, table: str) -> dict[str, datetime]:
    """Return when the newest file of each publication was written, if the file has only one."""
    found: dict[str, datetime] = {}
    for file in actions_of(store.table(table)).to_pylist():
        name, moment = _only(file), datetime.fromtimestamp(file["modification_time"] / 1000, UTC)
        if name is not None:
            found[name] = max(moment, found.get(name, moment))
    return found


def _damage(
    store: Store, table: str, entries: list[Published], counts: Mapping[str, int]
) -> Iterator[str]:
    """Yield a sentence for each run with missing rows, and for files that are missing or of another
    size.
    """
    expected = {one.publication(table): one for one in entries}
    wrong = [one for name, one in expected.items() if counts.get(name, 0) != one.rows[table]]
    for one in wrong[:MOST_NAMED]:
        rows = f"{counts.get(one.publication(table), 0)} of {one.rows[table]} rows"
        yield (
            f"{table}: {one.identity.run} version {one.version}: {rows} are there; publish the run"
            " into a new store"
        )
    if len(wrong) > MOST_NAMED:
        yield f"{table}: and {len(wrong) - MOST_NAMED} more runs"
    there = {file.name.removeprefix(f"{table}/"): file.size for file in store.place.listed(table)}
    bad = [
        f"{table}/{path}:"
        f" {'is missing' if path not in there else f'has {there[path]} bytes, the log says {size}'}"
        for path, size in _files(store.table(table))
        if there.get(path) != size
    ]
    yield from bad[:MOST_NAMED]
    if len(bad) > MOST_NAMED:
        yield f"{table}: and {len(bad) - MOST_NAMED} more files"


def _files(table: DeltaTable) -> Iterator[tuple[str, int]]:
    files = actions_of(table)
    return (
        (unquote(path), size)
        for path, size in zip(
            *(files[name].to_pylist() for name in ("path", "size_bytes")), strict=True
        )
    )


def _twice(entries: list[Published]) -> Iterator[str]:
    counts = Counter((one.identity.run, one.version) for one in entries)
    yield from (
        f"{RUNS}: {run} version {version} is there {count} times"
        for (run, version), count in counts.items()
        if count > 1
    )


def compact(place: Place) -> dict[str, tuple[int, int]]:
    """Join small files of each table and partition; return how many files were replaced by how
    many.

    May run beside publishers. The replaced files stay until `vacuum`. Raises `RecordError`.
    """
    expect_library()
    found = {}
    runs = opened(place, RUNS)  # once: a log of thousands of commits takes seconds to read
    for name in TABLES:
        report: dict[str, int] = {}

        def compact(name: str = name, report: dict[str, int] = report) -> None:
            report.update(_compacted(Store(place, None if name == RUNS else runs), name))

        if not committed(place, compact):
            raise RecordError(f"{place}: {name} changed meanwhile; compact it again")
        found[name] = report["numFilesRemoved"], report["numFilesAdded"]
    return found


def _compacted(store: Store, name: str) -> dict[str, int]:
    place, table = store.place, store.table(name)
    place.expect_plain(name)
    with explained(place.url):
        store.data_files(name).expect_bounded(path for path, _ in _files(table))
    return dict(
        table.optimize.compact(
            max_concurrent_tasks=1, writer_properties=writer(), commit_properties=properties()
        )
    )


def vacuum(place: Place, days: float = LEAST_DAYS) -> dict[str, int]:
    """Delete files that no version of the last `days` needs; return the number for each table.

    Raises `RecordError`; `UsageError` for less than seven days, and beside a publisher, whose files
    are in no version yet.
    """
    if days < LEAST_DAYS:
        raise UsageError(
            f"--days {days:g}: must be {LEAST_DAYS} or more: readers and publishers may still use"
            " younger files"
        )
    expect_library()
    at_work = live(place)
    if at_work:
        raise UsageError(
            f"{place}: a publisher is at work ({at_work[0]}); nothing was deleted. Try again when"
            " it has ended"
        )
    return {name: _vacuumed(place, name, days) for name in TABLES}


def _vacuumed(place: Place, name: str, days: float) -> int:
    table = opened(place, name)
    place.expect_plain(name)  # otherwise vacuum would follow links
    with explained(place.url):
        return len(table.vacuum(retention_hours=round(days * 24), dry_run=False, full=True))


def _hours(span: timedelta) -> str:
    return f"{span.total_seconds() / 3600:g} h"
