"""Many short pieces of one column at once: each from its first row to one behind its last. They may overlap.

None is empty, but `total` takes empty ones, too. A shift has thousands of joints, and numpy takes some microseconds a call: one
call for all of them costs what one joint did.
Results are those of the same call on each piece alone, to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.verdict.idle import Flags, Floats

Places = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Segments:
    """Pieces of a column. `rows` are those of all of them, one after the other; `begins` is where each begins in these."""

    first: Places
    last: Places
    rows: Places
    begins: Places

    @property
    def lengths(self) -> Places:
        return self.last - self.first

    def least(self, values: Floats) -> Floats:
        """The least value of each."""
        return np.minimum.reduceat(values[self.rows], self.begins) if len(self.first) else np.empty(0)

    def greatest(self, values: Floats) -> Floats:
        """The greatest value of each."""
        return np.maximum.reduceat(values[self.rows], self.begins) if len(self.first) else np.empty(0)

    def where_least(self, values: Floats) -> Places:
        """The row of each with the least value; the first of them."""
        return self.first_row(values[self.rows] == np.repeat(self.least(values), self.lengths))

    def where_greatest(self, values: Floats) -> Places:
        """The row of each with the greatest value; the first of them."""
        return self.first_row(values[self.rows] == np.repeat(self.greatest(values), self.lengths))

    def first_row(self, flags: Flags) -> Places:
        """The first row of each at which the flag is set; -1 where there is none. `flags` are those of `rows`."""
        hits = np.append(np.flatnonzero(flags), len(self.rows))
        hit = hits[np.searchsorted(hits, self.begins)]
        inside = hit < self.begins + self.lengths
        return np.where(inside, self.rows[np.where(inside, hit, 0)], -1) if len(self.first) else hit

    def total(self, values: Floats) -> Floats:
        """The sum of each. Pieces of one length together: the order in which numpy adds depends on the length."""
        found, lengths = np.zeros(len(self.first)), self.lengths
        for length in np.unique(lengths).tolist():
            here = np.flatnonzero(lengths == length)
            found[here] = values[self.first[here, np.newaxis] + np.arange(length)].sum(axis=1)
        return found


def segments(first: Places, last: Places) -> Segments:
    """The pieces from these rows to before those."""
    lengths = last - first
    ends = np.cumsum(lengths)
    begins = ends - lengths
    rows = np.arange(int(lengths.sum())) + np.repeat(first - begins, lengths)
    return Segments(first, last, rows, begins)


def runs(flags: Flags) -> tuple[Places, Places]:
    """Return the first row of each run of set flags, and the row after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    return edges[::2], edges[1::2]


def highest_running_sum(values: Floats, first: Places, last: Places, less: Floats) -> Places:
    """The row of each piece up to which the sum of its values, less so much each, is greatest. For pieces of some ten rows."""
    if not len(first):
        return first
    rows = first[:, np.newaxis] + np.arange(int((last - first).max()))
    inside = rows < last[:, np.newaxis]
    beyond = values[np.where(inside, rows, 0)] - less[:, np.newaxis]
    return np.asarray(first + np.where(inside, np.cumsum(np.where(inside, beyond, 0.0), axis=1), -np.inf).argmax(axis=1))
