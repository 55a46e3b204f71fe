"""Reductions of many short pieces of one column at once.

A piece is from its first row to the one after its last; pieces may overlap, and only `total`
accepts empty ones. A shift has thousands of joints and each numpy call costs some microseconds, so
one call serves all pieces. Results equal those of the same call on each piece, to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.port_data import Flags, Floats

Places = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Segments:
    """Pieces of a column. `rows` has the rows of all pieces in turn; `begins` is where each piece
    begins in `rows`.
    """

    first: Places
    last: Places
    rows: Places
    begins: Places

    @property
    def lengths(self) -> Places:
        return self.last - self.first

    def least(self, values: Floats) -> Floats:
        """Return the least value of each piece."""
        return (
            np.minimum.reduceat(values[self.rows], self.begins) if len(self.first) else np.empty(0)
        )

    def greatest(self, values: Floats) -> Floats:
        """Return the greatest value of each piece."""
        return (
            np.maximum.reduceat(values[self.rows], self.begins) if len(self.first) else np.empty(0)
        )

    def where_least(self, values: Floats) -> Places:
        """Return the first row of each piece that has its least value."""
        return self.first_row(values[self.rows] == np.repeat(self.least(values), self.lengths))

    def where_greatest(self, values: Floats) -> Places:
        """Return the first row of each piece that has its greatest value."""
        return self.first_row(values[self.rows] == np.repeat(self.greatest(values), self.lengths))

    def first_row(self, flags: Flags) -> Places:
        """Return the first row of each piece at which the flag is set, or -1; `flags` belong to
        `rows`.
        """
        hits = np.append(np.flatnonzero(flags), len(self.rows))
        hit = hits[np.searchsorted(hits, self.begins)]
        inside = hit < self.begins + self.lengths
        return np.where(inside, self.rows[np.where(inside, hit, 0)], -1) if len(self.first) else hit

    def total(self, values: Floats) -> Floats:
        """Return the sum of each piece. Pieces of one length are summed together, because numpy's
        order of adding depends on the length.
        """
        found, lengths = np.zeros(len(self.first)), self.lengths
        for length in np.unique(lengths).tolist():
            here = np.flatnonzero(lengths == length)
            found[here] = values[self.first[here, np.newaxis] + np.arange(length)].sum(axis=1)
        return found


def segments(first: Places, last: Places) -> Segments:
    """Return the pieces from the rows `first` to before the rows `last`."""
    lengths = last - first
    ends = np.cumsum(lengths)
    begins = ends - lengths
    rows = np.arange(int(lengths.sum())) + np.repeat(first - begins, lengths)
    return Segments(first, last, rows, begins)


def runs(flags: Flags) -> tuple[Places, Places]:
    """Return the first row of each run of set flags, and the row after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    return edges[::2], edges[1::2]


def rows_of_highest_sum(values: Floats, first: Places, last: Places, less: Floats) -> Places:
    """Return the row of each piece up to which the sum of its values, each minus `less`, is
    greatest.

    For pieces of some ten rows.
    """
    if not len(first):
        return first
    rows = first[:, np.newaxis] + np.arange(int((last - first).max()))
    inside = rows < last[:, np.newaxis]
    beyond = values[np.where(inside, rows, 0)] - less[:, np.newaxis]
    return np.asarray(
        first
        + np.where(inside, np.cumsum(np.where(inside, beyond, 0.0), axis=1), -np.inf).argmax(axis=1)
    )
