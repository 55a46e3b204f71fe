"""What an audit computes from a long ledger: 100 stations, read every day for two years.

It reads the ledger, checks its whole chain, classifies every difference, and computes use and
tasks. The baseline is the minimum for any reader: the lines of the same file through json.loads,
and hashed.
"""

from __future__ import annotations

import hashlib
import json
import resource
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from common import Claim, at_most, in_own_process, is_short, judge, show

sys.path.insert(0, str(Path(__file__).parents[1]))
from jbclog.config.tasks_file import load_tasks
from jbclog.maintenance.counter_totals.observed import Entry
from jbclog.maintenance.fleet_of_ledger import fleet_of
from jbclog.maintenance.ledger import add, read_book
from support.fleets.audit_fleet import Fleet

TASKS = Path(__file__).parents[2] / "profiles" / "tasks" / "bench.toml"
LIMIT_S, LIMIT_MB, RATIO = 15.0, 600.0, 20.0


def main() -> int:
    count = 20 if is_short(__doc__) else 100
    with TemporaryDirectory(prefix="jbclog-bench-") as made:
        path = Path(made) / "counters.jsonl"
        looks = len(add(path, entries(count)))
        read, reckoned, rss, right = in_own_process(audited, path)
        bare = in_own_process(parsed, path)
    rows = [
        ["read and checked", looks, read],
        ["judged and reckoned", looks, reckoned],
        ["json.loads and one hash", looks, bare],
    ]
    show(f"{count} stations, daily for two years", ("", "looks", "s of CPU"), rows)
    return judge(
        [
            Claim(
                "the chain holds, and every station has a row",
                right == count,
                f"{right} of {count}",
            ),
            at_most("reading and reckoning", read + reckoned, LIMIT_S * count / 100, " s of CPU"),
            at_most(
                "the same, of what json.loads and a hash of each line take",
                (read + reckoned) / bare,
                RATIO,
            ),
            at_most("memory", rss, LIMIT_MB, " MB"),
        ]
    )


def entries(count: int) -> Iterator[Entry]:
    """Yield the entries station by station, each in its own order; an audit needs no other."""
    for number in range(count):
        station = Fleet().station(5, number)
        yield from (*station.seen, *station.facts)


def audited(path: Path) -> tuple[float, float, float, int]:
    """Return CPU seconds to read and to compute, megabytes, and the number of stations (none if the
    chain is broken).
    """
    begun = time.process_time()
    book = read_book(path)
    read = time.process_time()
    seen = list({(one.line, one.station): one for one in book.observations}.values())
    audit = fleet_of(book, seen, seen[-1].time, load_tasks(TASKS))
    done = time.process_time()
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return read - begun, done - read, most, len(audit.stations) if book.is_sound else 0


def parsed(path: Path) -> float:
    """Return the CPU seconds of the minimal reader."""
    begun = time.process_time()
    for line in path.read_bytes().splitlines():
        json.loads(line)
        hashlib.sha256(line).hexdigest()
    return time.process_time() - begun


if __name__ == "__main__":
    sys.exit(main())
