"""Commits of a live store in which Python is refused memory at the Nth request and the next, for
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
from collections.abc import Sequence
from pathlib import Path

from jbclog.core.rows import StationFacts
from jbclog.record import live
from jbclog.record.batches import BARE, Batch
from jbclog.record.folder import create_run
from jbclog.record.live import LiveStore
from jbclog.record.store import FACTS, Segment
from support.records.few_rows import counter, event, sample, setting

AT_EASE = 3  # commits in a row that met no refusal: there are no more requests than that


def encode(number: int, table: str, values: list[object]) -> Batch:
    return Batch(number, table, len(values) // len(BARE[table]), json.dumps(values).encode())


def main(out: Path, many: int, step: int) -> None:
    live.COMMIT_S = 3600.0  # type: ignore[misc]  # the writer's thread waits; commits are made here
    live.encode = encode  # type: ignore[assignment]
    store = LiveStore(create_run(out, "bench", 1_790_000_000.0), seal_every_s=None)
    store.start()
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
        assert store._commit(), store.failure
        unreported += store.failure is not None and not store._is_failure_reported
    found = {"run": store.folder.name, "commits": commits, "met": met, "unreported": unreported}
    print(json.dumps({**found, "tables": tables(store.folder), "outages": outages(store.folder)}))


def tables(folder: Path) -> dict[str, list[list[object]]]:
    segment, found = Segment.look(folder / "live.sqlite"), dict[str, list[list[object]]]()
    for number, *_ in segment.index():
        stored = segment.get(number)
        assert stored is not None
        values, width = json.loads(stored.batch.data), len(BARE[stored.batch.table])
        found.setdefault(stored.batch.table, []).extend(
            values[n : n + width] for n in range(0, len(values), width)
        )
    return found


def outages(folder: Path) -> int:
    return int(json.loads(Segment.look(folder / "live.sqlite").notes(FACTS)["a"])["outages"])


def main_of(words: Sequence[str]) -> None:
    main(Path(words[1]), int(words[2]), int(words[3]))
