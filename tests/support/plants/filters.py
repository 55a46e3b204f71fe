"""Linear filters; scipy.signal is imported where it is used, because it takes half a second in each
worker.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def filtered(
    gain: float, poles: Sequence[float], steps: Floats, before: float | None = None
) -> Floats:
    """`steps` behind a filter with this denominator; `before` is its state."""
    from scipy.signal import lfilter

    state = None if before is None else np.array([before])
    found = (
        lfilter([gain], poles, steps)
        if state is None
        else lfilter([gain], poles, steps, zi=state)[0]
    )
    return np.asarray(found, dtype=np.float64)
