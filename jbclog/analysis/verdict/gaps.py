"""The longest time without a reading, and how long it was without what the computer skipped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jbclog.analysis.verdict.idle import Floats


@dataclass(slots=True)
class Gap:
    """The longest time between two moments of reading, less the period; `widest_s` is None while nothing was read.

    `start_s` is where the time begins to count, known with the first row.
    """

    period_s: float
    start_s: float | None = None
    last_s: float | None = None
    widest_s: float | None = None

    def take(self, there: Floats) -> None:
        """The next moments, in their order."""
        if not len(there):
            return
        before = self.last_s if self.last_s is not None else self.start_s
        steps = np.diff(np.append(there[0] if before is None else before, there)) - self.period_s
        self.widest_s = round(max(self.widest_s or 0.0, float(steps.max())), 6)
        self.last_s = float(there[-1])

    def end(self, end_s: float) -> None:
        """The last moment at which something was due."""
        if self.last_s is not None:
            self.take(np.array([end_s + self.period_s]))
