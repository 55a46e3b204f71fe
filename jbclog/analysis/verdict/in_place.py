"""When a tool was in its port and the port at work, as far as that was read.

Tool and port error are read every few seconds, temperature and power many times a second: of a tool that is pulled some readings
come before anybody knows. So a reading counts only where the last port error that was read before it and the first behind it both
say that the port works (`WORKS`, manuals 000 and 002; hot air has other codes, of which none is asked here), and where the
tool before and behind it is one and the same. Where nothing was read on one side the other decides; where neither was ever read,
nothing is known against the tool.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

WORKS = (0.0, 9.0)  # ok; a warning of overload


def in_place(tool: Floats, port_error: Floats) -> Flags:
    """Of each row of one port, in their order. `tool` and `port_error` are codes, NaN where they were not read."""
    if _is_never_changed(tool) and np.isin(port_error[~np.isnan(port_error)], WORKS).all():
        return np.ones(len(tool), dtype=np.bool_)  # as nearly always, and ten times as fast
    before, behind = _neighbours(tool)
    is_same = np.isnan(before) | np.isnan(behind) | (before == behind)
    works = _is_good(tool, tool > 0) & _is_good(port_error, np.isin(port_error, WORKS))
    return np.asarray(is_same & works, dtype=np.bool_)


def _is_never_changed(tool: Floats) -> bool:
    read = tool[~np.isnan(tool)]
    return not len(read) or bool(read[0] > 0 and (read == read[0]).all())


def behind_all(tool: Floats, port_error: Floats) -> Flags:
    """Which rows come when neither was read any more, though it had been: nothing bears them out."""
    read = np.flatnonzero(~np.isnan(tool) | ~np.isnan(port_error))
    rows = np.arange(len(tool))
    return np.asarray(rows > read[-1] if len(read) else np.zeros(len(tool)), dtype=np.bool_)


def _is_good(codes: Floats, good: Flags) -> Flags:
    before, behind = _neighbours(np.where(np.isnan(codes), np.nan, good.astype(np.float64)))
    return np.asarray((before != 0.0) & (behind != 0.0), dtype=np.bool_)  # NaN is not 0 either: nothing was read there


def _neighbours(codes: Floats) -> tuple[Floats, Floats]:
    """The last code that was read up to each row, and the first from it on; NaN where there is none."""
    return _held(codes), _held(codes[::-1])[::-1]


def _held(codes: Floats) -> Floats:
    last = np.maximum.accumulate(np.where(np.isnan(codes), -1, np.arange(len(codes))))
    return np.asarray(np.where(last >= 0, codes[last], np.nan), dtype=np.float64)
