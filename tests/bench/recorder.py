"""jbclog as a contender: a whole run, with its cost and how well it kept its grid."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pyarrow.parquet as pq
from common import cpu_s, percentile

from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.app.run.run_record import Result
from jbclog.app.run.runner import conduct
from jbclog.core.goal import Goal
from jbclog.core.rows import EventRow
from jbclog.record.seal_child import SEAL_S
from jbclog.session.run.context import SessionContext
from support.product import wire_paths
from support.readers.run_files import read_rows


@dataclass(frozen=True, slots=True)
class Recorded:
    """One run. CPU is that of the recorder and its sealing children, from when all stations sample
    until the first has ended.
    """

    began: float  # that time, monotonic seconds
    seconds: float
    exchanges: int  # in that time
    cpu_us: float  # per exchange in that time
    cpu_all_us: float  # per exchange, from opening the ports to the sealed and judged record
    stations: int
    rows: int
    ticks_skipped: int
    late_ms: tuple[float, float, float]  # of each tick's first question: 50 %, 99 %, the latest
    late_tenths_ms: list[float]  # 99th percentile of each tenth of the rows, ascending
    worst_slow_periods: float  # the longest that any slow reading waited, in its own periods
    shortest_scan_s: float  # of a port's row, which holds three reads at least
    recording_mb: float  # peak memory until the record is sealed
    peak_mb: float  # the same with the verdict, before the rows are examined
    trouble: list[str]  # problems that the run itself found
    wire_bytes: int  # size of the capture on disk
    wire_exchanges: int  # in the capture


class Mark(NamedTuple):
    moment: float
    cpu_s: float
    exchanges: int


class Watcher:
    """Looks each second while all stations sample."""

    def __init__(self) -> None:
        self.first: Mark | None = None
        self.last: Mark | None = None
        self.recording_mb = 0.0

    def begun(self, folder: Path) -> None: ...

    def happened(self, event: EventRow) -> None: ...

    def second(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> None:
        if all(
            context.state.facts.first_tick is not None and context.state.facts.outcome == "running"
            for context in contexts
        ):
            self.last = Mark(
                time.monotonic(), cpu_s(), sum(context.station.exchanges for context in contexts)
            )
            self.first = self.first or self.last

    def sealing(self) -> None:
        self.recording_mb = _peak_mb()


def record(
    line: Path,
    recipe: Path,
    out: Path,
    seconds: float,
    *,
    rate: str | None = None,
    seal_every_s: float = SEAL_S,
    wire: bool = False,
) -> Recorded:
    """Run the stations of `line` for `seconds`, as ``jbclog run`` does, with ``--capture`` where
    `wire` says so.
    """
    plan = make_plan(RunOptions(line, recipe, duration_s=seconds, rate=rate, wire=wire))
    watcher, before = Watcher(), cpu_s()
    result = conduct(plan, out, watcher, seal_every_s=seal_every_s)
    return _recorded(result, watcher, cpu_s() - before)


def _recorded(result: Result, watcher: Watcher, cpu_all_s: float) -> Recorded:
    first, last = watcher.first, watcher.last
    if first is None or last is None or first == last:
        raise RuntimeError(
            "the stations never sampled together for two seconds:"
            f" {[one.text for one in result.findings]}"
        )
    exchanges, stations = last.exchanges - first.exchanges, result.manifest.stations
    peak = _peak_mb()
    samples = pq.read_table(
        result.folder / "samples", columns=["seq", "port", "late_us", "scan_us", "reasons"]
    ).sort_by("seq")  # a part is sorted by port
    late = _late_ms(samples["port"].to_pylist(), samples["late_us"].to_pylist())
    skipped = sum("skipped" in reasons for reasons in samples["reasons"].to_pylist() if reasons)
    return Recorded(
        began=first.moment,
        seconds=last.moment - first.moment,
        exchanges=exchanges,
        cpu_us=(last.cpu_s - first.cpu_s) / exchanges * 1e6,
        cpu_all_us=cpu_all_s / last.exchanges * 1e6,
        stations=len(stations),
        rows=samples.num_rows,
        ticks_skipped=skipped + sum(facts.skipped for facts in stations),
        late_ms=(percentile(late, 50), percentile(late, 99), max(late)),
        late_tenths_ms=sorted(percentile(part, 99) for part in _tenths(late)),
        worst_slow_periods=max(facts.worst_slow_periods for facts in stations),
        shortest_scan_s=min(us for us in samples["scan_us"].to_pylist() if us is not None) / 1e6,
        recording_mb=watcher.recording_mb,
        peak_mb=peak,
        trouble=[finding.text for finding in result.findings],
        wire_bytes=sum(path.stat().st_size for path in wire_paths(result.folder)),
        wire_exchanges=sum(
            row.what == "sent" for path in wire_paths(result.folder) for row in read_rows(path)
        ),
    )


def _late_ms(ports: list[int], late_us: list[int | None]) -> list[float]:
    """Return the lateness of each tick: that of its first port, because the others wait for the
    link.
    """
    return [
        us / 1000 for port, us in zip(ports, late_us, strict=True) if port == 1 and us is not None
    ] or [0.0]


def _tenths(values: list[float]) -> Iterator[list[float]]:
    """Yield ten equal parts, without empty ones."""
    ends = [len(values) * number // 10 for number in range(11)]
    return (values[first:end] for first, end in pairwise(ends) if end > first)


def _peak_mb() -> float:
    """Return the peak memory of this process."""
    status = Path("/proc/self/status").read_text()
    return (
        int(next(line for line in status.splitlines() if line.startswith("VmHWM")).split()[1])
        / 1024
    )
