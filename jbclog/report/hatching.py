"""Hatching as strokes within a rectangle, so that it is the same on a screen and on paper: missing data by their reason."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rect = tuple[float, float, float, float]  # left, top, right, bottom

STEP: Final = 4.2  # points between strokes
PATTERNS: Final = {"/": (1,), "x": (1, -1), "-": (0,), "+": (0, 2), ".": ()}
"""A pattern's strokes by its letter: rising, falling, level, upright; a dot has none."""


def hatching(x: float, y: float, width: float, height: float, pattern: str) -> list[Floats]:
    """The strokes of ``///``, ``xxx``, ``---``, ``+++`` or ``...`` in a rectangle (left, top, width, height)."""
    rect = (x, y, x + width, y + height)
    kinds = PATTERNS[pattern[0]]
    return [stroke for kind in kinds for stroke in _strokes(kind, rect)] if kinds else list(_dots(rect))


def _strokes(kind: int, rect: Rect) -> Iterator[Floats]:
    left, top, right, bottom = rect
    if kind == 0:
        yield from (np.array([(left, y), (right, y)]) for y in _grid(top, bottom, STEP * 0.6))
    elif kind == 2:
        yield from (np.array([(x, top), (x, bottom)]) for x in _grid(left, right, STEP))
    else:
        yield from _slanted(kind, rect)


def _slanted(kind: int, rect: Rect) -> Iterator[Floats]:
    """Strokes of 45°, cut at the edges: y = base - kind × x."""
    left, top, right, bottom = rect
    low, high = sorted((top + kind * left, top + kind * right))
    for base in _grid(low, high + bottom - top, STEP * 1.2):
        starts, ends = sorted((kind * (base - top), kind * (base - bottom)))
        a, b = max(left, starts), min(right, ends)
        if b > a:
            yield np.array([(a, base - kind * a), (b, base - kind * b)])


def _dots(rect: Rect) -> Iterator[Floats]:
    left, top, right, bottom = rect
    for row, y in enumerate(_grid(top, bottom, STEP * 0.7)):
        for x in _grid(left, right - 0.6, STEP):
            at = x + (row % 2) * STEP / 2
            if at + 0.6 <= right:
                yield np.array([(at, y), (at + 0.6, y)])


def _grid(start: float, stop: float, step: float) -> list[float]:
    """Multiples of `step` strictly between, so that neighbours go on from each other."""
    return [n * step for n in range(int(np.floor(start / step)) + 1, int(np.ceil(stop / step)))]
