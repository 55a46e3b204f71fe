"""The eight tests for special causes (Nelson 1984), on points in standard deviations from the
centre line.

A signal is at the point that completes a pattern. Points on a line belong to neither side of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Zones = NDArray[np.float64]
"""Distances of points from the centre line, in standard deviations."""
Windows = NDArray[np.float64]
"""Windows of as many neighbouring points as a test examines, a row each."""
BEYOND_3 = 0.0026998  # share of a normal process beyond three sigma


@dataclass(frozen=True, slots=True)
class Signal:
    """Test `test` is met by the points from `first` to `last` (counted from 0)."""

    test: int
    first: int
    last: int

    @property
    def text(self) -> str:
        return TESTS[self.test - 1].text


@dataclass(frozen=True, slots=True)
class Test:
    """A test: how many neighbouring points it examines, and whether they are unusual.

    `rate` is how often a point of a stable normal process completes the pattern, if a closed form
    is known.
    """

    points: int
    text: str
    meets: Callable[[Windows], NDArray[np.bool_]]
    rate: float | None = None


def _beyond(sigmas: float, enough: int) -> Callable[[Windows], NDArray[np.bool_]]:
    """Return a test: enough points, the last among them, are beyond this many sigmas on the same
    side.
    """

    def meets(windows: Windows) -> NDArray[np.bool_]:
        above, below = windows > sigmas, windows < -sigmas
        high = (above.sum(axis=1) >= enough) & above[:, -1]
        low = (below.sum(axis=1) >= enough) & below[:, -1]
        return np.asarray(high | low, dtype=np.bool_)

    return meets


def _trend(windows: Windows) -> NDArray[np.bool_]:
    steps = np.diff(windows, axis=1)
    return np.asarray((steps > 0).all(axis=1) | (steps < 0).all(axis=1), dtype=np.bool_)


def _alternating(windows: Windows) -> NDArray[np.bool_]:
    steps = np.diff(windows, axis=1)
    return np.asarray((steps[:, 1:] * steps[:, :-1] < 0).all(axis=1), dtype=np.bool_)


def _hugging(windows: Windows) -> NDArray[np.bool_]:
    return np.asarray((np.abs(windows) < 1).all(axis=1), dtype=np.bool_)


def _avoiding(windows: Windows) -> NDArray[np.bool_]:
    both = (windows > 1).any(axis=1) & (windows < -1).any(axis=1)
    return np.asarray(both & (np.abs(windows) > 1).all(axis=1), dtype=np.bool_)


TESTS = (
    Test(1, "one point beyond three sigma", _beyond(3, 1), rate=BEYOND_3),
    Test(9, "nine points in a row on one side of the centre", _beyond(0, 9), rate=1 / 511),
    Test(6, "six points in a row steadily rising or falling", _trend),
    Test(14, "fourteen points in a row alternating up and down", _alternating),
    Test(3, "two of three points beyond two sigma on one side", _beyond(2, 2)),
    Test(5, "four of five points beyond one sigma on one side", _beyond(1, 4)),
    Test(15, "fifteen points in a row within one sigma", _hugging),
    Test(8, "eight points in a row beyond one sigma, on both sides", _avoiding),
)


ALL_TESTS = tuple(range(1, 9))
DEFAULT_TESTS = (1, 2, 3, 5)
"""Default tests of a chart. With all eight, most stable series of a hundred points have a
signal.
"""


@dataclass(frozen=True, slots=True)
class FalseAlarms:
    """False alarms of tests on a stable normal process, by simulation (`false_alarms`).

    - `per_100`: signals in 100 points with known limits, counted where they begin
    - `run_length`: points to the first signal on average, with known limits
    - `series`: share of series of 100 points with a signal, with limits from the series itself
    """

    per_100: float
    run_length: float
    series: float

    @property
    def text(self) -> str:
        return (
            f"on a stable process {self.per_100:.2g} false alarms in 100 points, the first after"
            f" {self.run_length:.0f} on average; {100 * self.series:.0f} % of series of 100"
            " have one"
        )


FALSE_ALARMS = {
    DEFAULT_TESTS: FalseAlarms(0.87, 118.0, 0.53),
    ALL_TESTS: FalseAlarms(1.46, 74.0, 0.71),
}
"""For the default tests and for all eight; a campaign compares them with a new simulation."""


def false_alarms(tests: tuple[int, ...], series: int, seed: int) -> FalseAlarms:
    """Simulate this many series of 100 stable points and return the tests' false alarms."""
    generator = np.random.default_rng(seed)
    points = generator.normal(size=100 * series)
    at = np.unique([one.last for one in signals(points, tests)])
    begun = at[np.diff(at, prepend=-2) > 1] if len(at) else at
    lengths, start = [], 0
    while start < len(points) - 5000:  # each run starts anew, without the points before its start
        ahead = points[start : start + 5000]
        first = min((one.last for one in signals(ahead[:500], tests)), default=None)
        if first is None:
            first = min((one.last for one in signals(ahead, tests)), default=len(ahead) - 1)
        lengths.append(first + 1)
        start += first + 1
    rows = generator.normal(size=(series, 100))
    sigma = np.abs(np.diff(rows, axis=1)).mean(axis=1, keepdims=True) * sqrt(pi) / 2
    zones = (rows - rows.mean(axis=1, keepdims=True)) / sigma
    signalling = sum(bool(signals(row, tests)) for row in zones)
    return FalseAlarms(100 * len(begun) / len(points), float(np.mean(lengths)), signalling / series)


def signals(zones: Zones, tests: tuple[int, ...] = ALL_TESTS) -> tuple[Signal, ...]:
    """Return all signals of these tests, ordered by the points that complete them."""
    found: list[Signal] = []
    for number in tests:
        test = TESTS[number - 1]
        if len(zones) >= test.points:
            places = np.flatnonzero(test.meets(sliding_window_view(zones, test.points)))
            found += [Signal(number, int(place), int(place) + test.points - 1) for place in places]
    return tuple(sorted(found, key=lambda one: (one.last, one.test)))
