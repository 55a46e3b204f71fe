"""How much of a store is read: ``python tests/bench/bench_store.py [--short]``.

Sealed runs of one station, an hour apart (``--short``: a few), are published into a folder. Bytes
are those that the process reads from the system (`rchar` of /proc), so unread columns and
partitions do not count. Limits are shares of the size of the samples table, which do not differ
between machines.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

from common import at_most, is_short, judge, show

import jbclog
from jbclog.analysis.store.place import place_of
from jbclog.analysis.trend import trends
from jbclog.app.publish.folder import publish_all
from jbclog.app.publish.publisher import Publisher
from support.records.many_runs import one_run

RUNS, SHORT_RUNS = 60, 6
ROWS = 20_000


def bytes_read(call: Callable[[], object]) -> int:
    before = _rchar()
    call()
    return _rchar() - before


def _rchar() -> int:
    lines = Path("/proc/self/io").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("rchar:"))


def size(store: Path, table: str) -> int:
    return sum(path.stat().st_size for path in (store / table).rglob("*.parquet"))


def main() -> int:
    count = SHORT_RUNS if is_short(__doc__) else RUNS
    with TemporaryDirectory() as made:
        home, store = Path(made, "runs"), Path(made, "store")
        for number in range(count):
            one_run(home, number, 0.2, rows=ROWS)
        began = time.process_time()
        with Publisher(place_of(store)) as publisher:
            done = [*publish_all(publisher, home)]
        publish_s = (time.process_time() - began) / len(done)
        samples = size(store, "samples")
        whole = bytes_read(lambda: [None for _ in jbclog.open_runs(store).samples()])
        column = bytes_read(
            lambda: [None for _ in jbclog.open_runs(store).samples(columns=["temperature_c"])]
        )
        one = bytes_read(lambda: jbclog.open_runs(store)[0].samples())
        trend = bytes_read(lambda: trends(jbclog.open_runs(store), "idle_error_c"))
        found = bytes_read(lambda: jbclog.open_runs(store, line="another").found)
    rows = {
        "all samples": whole,
        "one column of all runs": column,
        "one run": one,
        "a trend over all runs": trend,
        "no run": found,
    }
    shares = [[text, read, read / samples] for text, read in rows.items()]
    show(f"{count} runs, {samples} bytes of samples", ["", "bytes read", "share"], shares)
    show("publishing", ["", "CPU a run, s"], [[f"{ROWS} rows", publish_s]])
    return judge(
        [
            at_most("one column of all runs, share of the samples", column / samples, 0.6),
            at_most("one run of all, share of the samples", one / samples, 1.2 / count + 0.2),
            at_most("a trend over all runs, share of the samples", trend / samples, 0.6),
            at_most("runs of a line that is not there, share of the samples", found / samples, 0.2),
        ]
    )


if __name__ == "__main__":
    raise SystemExit(main())
