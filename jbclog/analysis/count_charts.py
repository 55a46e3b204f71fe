"""Charts of counts, in a run and over runs: control charts of alarms and of rejects, and Pareto
charts of alarms and of losses.

Alarms are counted per interval of a run, or per run, over the hours recorded (u chart); rejects are
the share of the judged runs of a day (p chart); a Pareto chart ranks alarms by limit, and losses by
reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd

from jbclog.analysis import spc
from jbclog.analysis.alarms.state_machine import Detector, Episode
from jbclog.analysis.run import Run
from jbclog.analysis.runs import Runs
from jbclog.analysis.spc.distribution import Floats
from jbclog.analysis.spc.refusal import there_are
from jbclog.core.errors import UsageError

COUNTED: Final = {"alarms": ("u", "pareto"), "rejects": ("p",), "losses": ("pareto",)}
"""Counted metrics and their charts; the first is the default."""
LEAST_COUNTED: Final = 10
# the station answered that it counts nothing now: no loss
NO_LOSS: Final = frozenset({"due", "ok", "not_counting"})


@dataclass(frozen=True, slots=True, eq=False)
class Counted:
    """A u or p chart, or why there is none; `sizes` are hours or runs."""

    metric: str
    kind: str
    names: list[str]
    counts: Floats
    sizes: Floats
    chart: spc.Chart | spc.Refused


@dataclass(frozen=True, slots=True)
class Ranked:
    """A Pareto chart: rows of name, count, per cent of all, and cumulative per cent."""

    metric: str
    total: int
    rows: list[tuple[str, int, float, float]]


def alarms_in_run(run: Run, every_s: float) -> Counted:
    """Return the u chart of alarms by our samples in intervals of `every_s` of a run.

    Raises `UsageError`.
    """
    if not (np.isfinite(every_s) and every_s > 0):
        raise UsageError(f"a stretch must be longer than 0 s (got {every_s:g})")
    begin, end = _span(run) or (0.0, 0.0)
    # the last interval may be shorter; its limits follow its length
    edges = np.append(np.arange(begin, end, every_s), end)
    raised = np.clip([one.onset_us / 1e6 for one in _episodes(run)], begin, end)
    counts = np.histogram(raised, edges)[0].astype(np.float64) if len(edges) > 1 else np.zeros(0)
    names = [f"{pd.Timestamp(at, unit='s'):%Y-%m-%d %H:%M:%S}" for at in edges[:-1]]
    return _u_chart("stretches", names, counts, np.diff(edges) / 3600)


def alarms_in_runs(runs: Runs) -> Counted:
    """Return the u chart of alarms by our samples, per run over its hours."""
    names, counts, sizes = [], [], []
    for one, (span, episodes) in runs.each(lambda one: _counted_in(runs.open(one))):
        if span is not None:
            names.append(one.folder.name)
            counts.append(float(episodes))
            sizes.append((span[1] - span[0]) / 3600)
    return _u_chart("runs", names, np.array(counts), np.array(sizes))


def _counted_in(run: Run) -> tuple[tuple[float, float] | None, int]:
    """Return the time that a run spans, and its number of alarms by our samples."""
    span = _span(run)
    return span, 0 if span is None else len(_episodes(run))


def rejects(runs: Runs) -> Counted:
    """Return the p chart of rejected runs among the judged runs of each day (UTC)."""
    judged: Counter[str] = Counter()
    rejected: Counter[str] = Counter()
    for one in runs.found:
        if one.verdict is not None and one.start is not None:
            day = one.start[:10]
            judged[day] += 1
            rejected[day] += one.verdict == "REJECT"
    names = sorted(judged)
    counts, sizes = (
        np.array([which[name] for name in names], dtype=np.float64) for which in (rejected, judged)
    )
    refused = _too_few(len(names), "days with a judged run")
    return Counted("rejects", "p", names, counts, sizes, refused or spc.shares(counts, sizes))


def ranked_alarms(source: Run | Runs) -> Ranked:
    """Return the Pareto chart of alarms by our samples, by station, port and limit."""
    return ranked("alarms", _added(source, _alarm_counts))


def ranked_losses(source: Run | Runs) -> Ranked:
    """Return the Pareto chart of lost readings, by station and reason."""
    return ranked("losses", _added(source, loss_counts))


def _added(source: Run | Runs, count: Callable[[Run], Counter[str]]) -> Counter[str]:
    if isinstance(source, Run):
        return count(source)
    return sum(
        (counts for _, counts in source.each(lambda one: count(source.open(one)))), Counter()
    )


def _alarm_counts(run: Run) -> Counter[str]:
    return Counter(f"{one.station} port {one.port} {one.side}" for one in _episodes(run))


def loss_counts(run: Run) -> Counter[str]:
    """Return the number of lost readings of a run by station and reason."""
    lost: Counter[str] = Counter()
    for station, ports in run.manifest.ledger.items():
        for signals in ports.values():
            for counts in signals.values():
                lost.update(
                    {
                        f"{station} {reason}": n
                        for reason, n in counts.items()
                        if reason not in NO_LOSS and n
                    }
                )
    return lost


def ranked(metric: str, counted: Mapping[str, int]) -> Ranked:
    """Return a Pareto chart, most frequent first, ties by name."""
    total, so_far, rows = sum(counted.values()), 0, []
    for name, count in sorted(counted.items(), key=lambda one: (-one[1], one[0])):
        so_far += count
        rows.append((name, count, 100 * count / total, 100 * so_far / total))
    return Ranked(metric, total, rows)


def _u_chart(what: str, names: list[str], counts: Floats, hours: Floats) -> Counted:
    return Counted(
        "alarms", "u", names, counts, hours, _too_few(len(names), what) or spc.rates(counts, hours)
    )


def _too_few(count: int, what: str) -> spc.Refused | None:
    if count >= LEAST_COUNTED:
        return None
    return spc.Refused(
        "too_few", f"{there_are(count, what)}; a chart of counts takes at least {LEAST_COUNTED}."
    )


def _episodes(run: Run) -> list[Episode]:
    found = run.alarm_findings().incidents
    return [each for one in found for each in one.episodes if each.detector is Detector.SAMPLES]


def _span(run: Run) -> tuple[float, float] | None:
    """Return the first and last row's times in s since 1970; None: the same, or no row."""
    begin, end = np.inf, -np.inf
    for piece in run.stream("samples", columns=["time"]):
        micros = piece["time"].astype("int64")
        begin, end = min(begin, float(micros.min()) / 1e6), max(end, float(micros.max()) / 1e6)
    return (begin, end) if end > begin else None
