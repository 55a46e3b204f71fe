"""The minute of a long run that is worth a closer look, so that single joints can be seen in it."""

from __future__ import annotations

import numpy as np

from jbclog.report.trace import Trace

WINDOW_S = 60.0
LONG_S = 180.0  # shorter runs are looked at closely enough by their first figure


def closer(trace: Trace) -> tuple[Trace, str] | None:
    """One minute of the trace and why that one; None for a short run."""
    if trace.end - trace.start <= LONG_S:
        return None
    middle, why = _moment(trace)
    start = min(max(middle - WINDOW_S / 2, trace.start), trace.end - WINDOW_S)
    return trace.between(start, start + WINDOW_S), why


def _moment(trace: Trace) -> tuple[float, str]:
    for kind, why in (("alarm", "the first alarm"), ("unconfirmed", "the first doubtful alarm"), ("error", "the first error")):
        first = next((mark for mark in trace.marks if mark.kind == kind), None)
        if first is not None:
            return (first.span.start + first.span.end) / 2, why
    hottest = _hottest(trace)
    return (hottest, "the hottest reading") if hottest is not None else ((trace.start + trace.end) / 2, "the middle of the run")


def _hottest(trace: Trace) -> float | None:
    """When the tip was hottest; None where it was never read."""
    if np.isnan(trace.temperature).all():
        return None
    return float(trace.seconds[int(np.nanargmax(trace.temperature))])
