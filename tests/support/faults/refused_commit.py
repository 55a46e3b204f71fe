"""Commits of a journal in which Python is refused memory at the Nth request and the next, for
each N (a process of its own).

::

    main_of(["", OUT, MANY, STEP])   # prints, as JSON, how many commits were tried, and what each
    table holds then

Rows are stored as JSON here: the Arrow library ends a process that refuses memory to it, which is
the guard's to see to.
"""

from __future__ import annotations

import _testcapi
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from jbclog.core.rows import TABLES, StationFacts
from jbclog.record import run_journal
from jbclog.record.folder import create_run
from jbclog.record.frames import Commit, Frame, FrameKind, read_items
from jbclog.record.row_batches import BARE
from jbclog.record.run_journal import RunJournal
from jbclog.record.segments import segments
from support.records.few_rows import counter, event, sample, setting

AT_EASE = 3  # commits in a row that met no refusal: there are no more requests than that


def encode(table: str, values: list[object], first: int, number: int) -> Frame:
    data = json.dumps(values).encode()
    rows = len(values) // len(BARE[table])
    return Frame(FrameKind.ROWS, data, len(data), number, first, rows)


def main(out: Path, many: int, step: int) -> None:
    run_journal.COMMIT_S = 3600.0  # type: ignore[misc]  # the writer's thread waits; commits are made here
    run_journal.encode = encode  # type: ignore[assignment]
    store = RunJournal(create_run(out, "bench", 1_790_000_000.0), seal_every_s=None)
    store.start()
    store._committing.acquire()  # never the writer's thread
    met = commits = at_ease = unreported = 0
    while at_ease < AT_EASE:
        store.sample(sample(commits))
        store.event(event(commits))
        store.setting(setting(commits))
        store.counter(counter(commits))
        store.facts(StationFacts("a", "a.pty", "dde", outages=commits))
        store.failure, store._is_failure_reported = None, False
        is_safe = False
        _testcapi.set_nomemory(1 + commits * step, 1 + commits * step + many)
        try:
            is_safe = store._commit()
        except MemoryError:
            pass
        finally:
            _testcapi.remove_mem_hooks()
        at_ease = at_ease + 1 if is_safe else 0
        met += not is_safe
        commits += 1
        assert store._commit(is_closing=True), store.failure
        unreported += store.failure is not None and not store._is_failure_reported
    found = {"run": store.folder.name, "commits": commits, "met": met, "unreported": unreported}
    print(json.dumps({**found, "tables": tables(store.folder), "outages": outages(store.folder)}))


def commits_in(folder: Path) -> Iterator[Commit]:
    for path in segments(folder):
        with path.open("rb") as file:
            for item in read_items(file):
                if isinstance(item, Commit):
                    yield item


def tables(folder: Path) -> dict[str, list[list[object]]]:
    """The rows of each table in the order of `seq`; a row may be there twice."""
    rows: dict[str, dict[int, list[object]]] = {table: {} for table in TABLES}
    for commit in commits_in(folder):
        for frame in commit.frames:
            if frame.kind is FrameKind.ROWS:
                table = TABLES[frame.table]
                values, width = json.loads(frame.packed), len(BARE[table])
                for number in range(frame.rows):
                    row = values[number * width : (number + 1) * width]
                    assert rows[table].setdefault(frame.first + number, row) == row
    return {table: [rows[table][seq] for seq in sorted(rows[table])] for table in TABLES}


def outages(folder: Path) -> int:
    facts = {}
    for commit in commits_in(folder):
        for frame in commit.frames:
            if frame.kind is FrameKind.FACTS:
                facts.update(json.loads(frame.payload()))
    return int(facts["a"]["outages"])


def main_of(words: Sequence[str]) -> None:
    main(Path(words[1]), int(words[2]), int(words[3]))
