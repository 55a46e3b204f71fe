"""What many runs cost: ``python tests/bench/bench_many_runs.py [--short]``.

240 runs share one record of two stations with its report (``--short``: 60). The figures are CPU per
run, the minimum of interleaved rounds: finding the runs as `jbclog runs` does; a trend of one
metric over them, over as many with a recorder's metrics instead of a report, and over a few with
neither. The baseline reads each `manifest.json` and parses
it with Python's `json`, without any check.

The limits are ratios to that baseline, which differ little between machines, and 3 ms a run for a
trend.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

from common import at_most, in_own_process, is_short, judge, show

from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import computed_metrics
from jbclog.analysis.runs import Records, open_runs
from jbclog.analysis.trend import trends
from jbclog.record.find_runs import find
from jbclog.record.folder import DERIVED
from jbclog.report.write import write_report
from support.records.derived import write_metrics
from support.records.same_record import as_another
from support.records.small_run import make_run

RUNS, SHORT_RUNS, WITHOUT = 240, 60, 4
RUN_S = 20.0
ROUNDS = 5
MOST_MS = 3.0
OF_REPORT = ("report.*", "annotations.jsonl", "derived", "figures", "tables")


def copies(run: Path, out: Path, count: int, ignore: tuple[str, ...] = ()) -> Path:
    """Make a folder of runs with the record of one, under names that a recorder gives."""
    for number in range(count):
        name = f"20261101T{number // 3600:02d}{number // 60 % 60:02d}{number % 60:02d}Z-bench-aaaa"
        as_another(run, out / name, ignore)
    return out


def parsed(out: Path) -> None:
    for folder in sorted(out.iterdir()):
        json.loads((folder / "manifest.json").read_bytes())


def trend(out: Path) -> None:
    found = trends(open_runs(out).through(Records()))
    assert len(found[0].known) == len(list(out.iterdir())), "a run lacks the metric"


def least_ms(calls: list[tuple[Callable[[Path], object], Path]], rounds: int) -> list[float]:
    """Return the minimum CPU in ms per run of each call, in interleaved rounds."""
    took: list[list[float]] = [[] for _ in calls]
    for _ in range(rounds):
        for (call, out), times in zip(calls, took, strict=True):
            begun = time.process_time()
            call(out)
            times.append((time.process_time() - begun) * 1000 / len(list(out.iterdir())))
    return [min(times) for times in took]


def measured(made: Path, count: int) -> list[float]:
    run = make_run(made, RUN_S)
    write_report(run)
    with_report = copies(run, made / "with", count)
    without = copies(run, made / "without", WITHOUT, OF_REPORT)
    first = next(without.iterdir())
    write_metrics(first, computed_metrics(open_run(first)))
    cached = copies(first, made / "cached", count)
    shutil.rmtree(first / DERIVED)
    calls = [
        (parsed, with_report),
        (lambda out: list(find(out)), with_report),
        (trend, with_report),
        (trend, cached),
    ]
    return least_ms(calls, ROUNDS) + least_ms([(trend, without)], 1)


def main() -> int:
    count = SHORT_RUNS if is_short(__doc__) else RUNS
    with TemporaryDirectory(prefix="jbclog-bench-") as made:
        plain, found, stored, cached, computed = in_own_process(measured, Path(made), count)
    rows = [
        ("manifest by json alone", plain),
        ("runs", found),
        ("trend, with reports", stored),
        ("trend, with what the recorder left", cached),
        (f"trend, {WITHOUT} runs without reports", computed),
    ]
    show(
        f"{count} runs",
        ["", "CPU a run, ms", "ratio"],
        [[text, ms, ms / plain] for text, ms in rows],
    )
    return judge(
        [
            at_most("runs, as against json.loads of each manifest", found / plain, 2.5),
            at_most("trend, as against json.loads of each manifest", stored / plain, 25),
            at_most("trend of runs with a report: CPU a run", stored, MOST_MS, " ms"),
            at_most("trend of runs that nobody has looked at: CPU a run", cached, MOST_MS, " ms"),
        ]
    )


if __name__ == "__main__":
    raise SystemExit(main())
