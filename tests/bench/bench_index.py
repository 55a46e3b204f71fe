"""What folders of thousands of runs cost: ``python tests/bench/bench_index.py [--short]``.

10 000 runs share the record of one run (``--short``: 1000) and the metrics that its recorder left.
`jbclog runs`, `where-used` and `trend` run as typed, each in a fresh process: without an index, the
first time with one, with nothing changed, and after 100 new runs (``--short``: 10). The start of
the program is included. Each has one thread, so on an idle machine wall time is CPU.

The claims are ratios within the same run, and limits in seconds for 10 000 runs.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

from common import Claim, at_most, in_own_process, is_short, judge, show

from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import computed_metrics
from jbclog.analysis.stored_tables import cache_metrics
from jbclog.record.manifest import manifest_sha256
from support.records.same_record import as_another
from support.records.small_run import make_run

RUNS, SHORT_RUNS = 10_000, 1000
SETTLE_S = 2.5  # just written files are not entered
MOST_S = {"runs": 1.0, "where-used": 1.0, "trend": 3.0}
MOST_SHARE = 0.5  # with the start of the program, most of it for few runs
WORDS = {"runs": (), "where-used": ("--station", "ale-1", "--since", "2040-01-01"), "trend": ()}
DIRECT = {"runs": ("--no-cache",), "where-used": ("--no-cache",), "trend": ()}


def made_run(out: Path) -> Path:
    run = make_run(out, 20.0)
    cache_metrics(run, computed_metrics(open_run(run)), manifest_sha256(run))
    return run


def add(run: Path, out: Path, begin: int, count: int) -> None:
    """Add runs with this record, under names that a recorder gives."""
    for number in range(begin, begin + count):
        name = f"20261101T{number // 3600:02d}{number // 60 % 60:02d}{number % 60:02d}Z-bench-aaaa"
        as_another(run, out / name)


def took(verb: str, out: Path, cache: Path, *more: str) -> tuple[float, float]:
    """Return the wall seconds and CPU seconds of a command."""
    command = [sys.executable, "-m", "jbclog", verb, str(out), *WORDS[verb], *more]
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
    subprocess.run(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment, check=True
    )
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measured(verb: str, run: Path, out: Path, cache: Path, new: int) -> list[tuple[float, float]]:
    """Measure without an index, the first time with one, twice without a change (the better one
    counts), and with new runs.
    """
    cache.mkdir()
    closed = cache / "closed"
    closed.write_bytes(b"")  # a file cannot contain a folder
    found = [took(verb, out, closed, *DIRECT[verb]), took(verb, out, cache)]
    found.append(min(took(verb, out, cache) for _ in range(2)))
    # another link would change the times of the shared files
    other = shutil.copytree(run, cache / "run")
    add(Path(other), out, len(list(out.iterdir())), new)
    time.sleep(SETTLE_S)
    return [*found, took(verb, out, cache)]


def main() -> int:
    count = SHORT_RUNS if is_short(__doc__) else RUNS
    with TemporaryDirectory(prefix="jbclog-bench-") as made:
        home = Path(made)
        run, out = in_own_process(made_run, home), home / "runs"
        out.mkdir()
        add(run, out, 0, count)
        time.sleep(SETTLE_S)
        results = {
            verb: measured(verb, run, out, home / f"cache of {verb}", count // 100)
            for verb in WORDS
        }
        sizes = {
            verb: (
                sum(path.stat().st_size for path in (home / f"cache of {verb}").rglob("*.sqlite"))
                / 1e6
            )
            for verb in WORDS
        }
    columns = [
        "",
        "without",
        "first",
        "unchanged",
        f"{count // 100} new",
        "without / unchanged",
        "unchanged, wall",
        "index, MB",
    ]
    rows = [
        [verb, *(cpu for _, cpu in those), those[0][1] / those[2][1], those[2][0], sizes[verb]]
        for verb, those in results.items()
    ]
    show(f"{count} runs, seconds of CPU", columns, rows)
    return judge([claim for verb, those in results.items() for claim in claims(verb, those, count)])


def claims(verb: str, found: list[tuple[float, float]], count: int) -> list[Claim]:
    (_, without), _, (_, unchanged), (_, new) = found
    return [
        at_most(f"{verb} of {count} runs without a change: CPU", unchanged, MOST_S[verb], " s"),
        at_most(
            f"{verb}: CPU with an index, of that without",
            unchanged / without,
            MOST_SHARE if count == RUNS else 0.95,
        ),
        at_most(
            f"{verb}: CPU after 1 % of new runs, of that without a change", new / unchanged, 1.5
        ),
    ]


if __name__ == "__main__":
    raise SystemExit(main())
