"""Splits rows of many ports by station and port.

A row group of a run of 32 ports has a thousand rows of each; for so few, the overhead of each numpy
or Arrow call dominates. So several row groups are split together.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator
from itertools import pairwise
from typing import Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbclog.analysis.coded_texts import coded
from jbclog.core.rows import PortKey

ROWS_OF_A_PORT: Final = 8192
MOST_ROWS: Final = 262_144  # together, some 20 MB
SMALL: Final = 256  # numbers of ports, and of stations in a piece, that fit into 8 bits


def gathered(pieces: Iterable[pa.Table], ports: int) -> Iterator[pa.Table]:
    """Yield the rows of these pieces in order, several pieces at once if so many ports have few
    rows each.
    """
    if ports < 2:
        yield from pieces
        return
    least, held, rows = min(ports * ROWS_OF_A_PORT, MOST_ROWS), list[pa.Table](), 0
    for piece in pieces:
        if held and held[0].schema != piece.schema:  # texts of a live store are not dictionaries
            yield _together(held)
            held, rows = [], 0
        held.append(piece)
        rows += len(piece)
        if rows >= least:
            yield _together(held)
            held, rows = [], 0
    if held:
        yield _together(held)


def _together(pieces: list[pa.Table]) -> pa.Table:
    if len(pieces) == 1:
        return pieces[0]
    return pa.concat_tables(pieces).unify_dictionaries().combine_chunks()


def by_port(rows: pa.Table) -> Iterator[tuple[PortKey, pa.Table]]:
    """Yield the rows of each port in order; without a copy if there is only one."""
    found, places = sorted_by_port(rows)
    for key, place in places:
        yield key, found.slice(place.start, place.stop - place.start)


def sorted_by_port(
    rows: pa.Table, wanted: Container[PortKey] | None = None
) -> tuple[pa.Table, list[tuple[PortKey, slice]]]:
    """Return the rows, or those of `wanted` ports, sorted by port, and the slice of each port."""
    if not rows.num_rows:
        return rows, []
    names, ports = coded(rows["station"]), rows["port"].to_numpy()
    stations = names.indices.to_numpy()

    def key_at(row: int) -> PortKey:
        return names.dictionary[int(stations[row])].as_py(), int(ports[row])

    if (stations == stations[0]).all() and (ports == ports[0]).all():
        key = key_at(0)
        is_wanted = wanted is None or key in wanted
        return rows, [(key, slice(0, len(ports)))] if is_wanted else []
    order = _order(stations, ports)
    of_row, at_row = stations[order], ports[order]
    edges = np.flatnonzero((np.diff(of_row) != 0) | (np.diff(at_row) != 0)) + 1
    parts = [
        (key, order[first:stop])
        for first, stop in pairwise([0, *edges.tolist(), len(order)])
        for key in [key_at(int(order[first]))]
        if wanted is None or key in wanted
    ]
    if not parts:
        return rows.slice(0, 0), []
    ends = np.cumsum([0, *(len(part) for _, part in parts)]).tolist()
    places = [
        (key, slice(first, stop))
        for (key, _), (first, stop) in zip(parts, pairwise(ends), strict=True)
    ]
    return rows.take(pa.array(np.concatenate([part for _, part in parts]))), places


def _order(stations: NDArray[np.integer], ports: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the order of the rows by station and port, stable within a port."""
    if ports.min() >= 0 and ports.max() < SMALL and stations.max() < SMALL:
        # numpy uses radix sort for 16-bit integers
        keys = (stations.astype(np.uint16) << 8) | ports.astype(np.uint16)
        return np.argsort(keys, kind="stable")
    return np.lexsort((ports, stations))
