"""The samples of a run, port by port.

A part holds the rows of a port together, so a port of a week is as many contiguous reads as there
are parts. Which ports a row group has is looked up once: in the footer's statistics where the
manifest vouches for them and the row group has one port, else in its columns `station` and `port`.

Parts of 0.1.0 are in the order of recording: every row group has all ports, and is read again for
each of them if it is no longer among those kept (`MOST_KEPT`). Ports with few rows share row groups
too.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa

from jbclog.core.rows import PortKey
from jbclog.record.part_file import PartFile
from jbclog.record.parts import NO_SEALS, SORTED, Seals, group_of, opened_part, part_paths

MOST_KEPT: Final = 64 << 20  # bytes of row groups with several ports, divided by port
KEY: Final = ("station", "port")


class Part(NamedTuple):
    """A part of the samples. `is_sealed`: its footer agrees with the manifest."""

    open: Callable[[], AbstractContextManager[PartFile]]
    is_sealed: bool


class SamplesByPort:
    """These columns of the samples of a run, `station` and `port` among them.

    `newest` are rows that are in no part yet, in the order of recording. A run that grows shows no
    row that came later.
    """

    def __init__(
        self,
        columns: Sequence[str],
        parts: Sequence[Part],
        newest: Iterable[pa.Table] = (),
        order: Iterable[PortKey] = (),
    ) -> None:
        """`order` has the ports that come first, whether they have rows or not. Raises
        `RecordError`.
        """
        self.columns = list(dict.fromkeys([*KEY, *columns]))
        self._parts = parts
        self._groups: dict[PortKey, list[tuple[int, int]]] = {}
        self._kept: OrderedDict[tuple[int, int, tuple[str, ...]], dict[PortKey, pa.Table]]
        self._kept = OrderedDict()
        self._kept_bytes = 0
        for number, part in enumerate(parts):
            with part.open() as file:
                for index in range(file.num_row_groups):
                    for key in _ports_of(file, index, is_sealed=part.is_sealed):
                        self._groups.setdefault(key, []).append((number, index))
        waiting = [rows.select(self.columns) for rows in newest if rows.num_rows]
        self._newest = split_by_port(pa.concat_tables(waiting)) if waiting else {}
        others = sorted({*self._groups, *self._newest})
        self.ports: list[PortKey] = list(dict.fromkeys([*order, *others]))

    def rows(self, key: PortKey, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """Yield the rows of a port in order, in some tables, none empty; all columns or these.
        Raises `RecordError`.
        """
        names = self.columns if columns is None else list(columns)
        for number, index in self._groups.get(key, ()):
            yield self._read(number, index, key, names).select(names)
        if key in self._newest:
            yield self._newest[key].select(names)

    def _read(self, number: int, index: int, key: PortKey, names: Sequence[str]) -> pa.Table:
        columns = tuple(dict.fromkeys([*KEY, *names]))
        place = (number, index, columns)
        if place in self._kept:
            self._kept.move_to_end(place)
            return self._kept[place][key]
        with self._parts[number].open() as file:
            divided = split_by_port(group_of(file, SORTED, index, columns))
        if len(divided) > 1:
            self._keep(place, divided)
        return divided[key]

    def _keep(
        self, place: tuple[int, int, tuple[str, ...]], divided: dict[PortKey, pa.Table]
    ) -> None:
        self._kept[place] = divided
        self._kept_bytes += _bytes_of(divided)
        while self._kept_bytes > MOST_KEPT:
            _, longest_unused = self._kept.popitem(last=False)
            self._kept_bytes -= _bytes_of(longest_unused)


def samples_by_port(
    folder: Path,
    columns: Sequence[str],
    newest: Iterable[pa.Table] = (),
    order: Iterable[PortKey] = (),
    *,
    parts: Iterable[Path] | None = None,
    seals: Seals = NO_SEALS,
) -> SamplesByPort:
    """Return the samples in the parts of a run's folder, all or these; the rest as
    `SamplesByPort`.
    """
    paths = part_paths(folder, SORTED) if parts is None else parts
    opened = [
        Part(partial(opened_part, path, seals.get(path)), seals.get(path) is not None)
        for path in paths
    ]
    return SamplesByPort(columns, opened, newest, order)


def split_by_port(rows: pa.Table) -> dict[PortKey, pa.Table]:
    """Return the rows of each port, in their order; without a copy if there is one port."""
    if not rows.num_rows:
        return {}
    stations = rows["station"].combine_chunks().dictionary_encode()
    names = stations.indices.to_numpy()
    ports = rows["port"].to_numpy()
    order = np.lexsort((ports, names))  # stable
    is_other_port = (np.diff(names[order]) != 0) | (np.diff(ports[order]) != 0)
    firsts = [0, *(np.flatnonzero(is_other_port) + 1).tolist()]
    ordered = rows.take(pa.array(order)) if len(firsts) > 1 else rows
    divided: dict[PortKey, pa.Table] = {}
    for first, stop in pairwise([*firsts, len(order)]):
        row = int(order[first])
        key = stations.dictionary[int(names[row])].as_py(), int(ports[row])
        divided[key] = ordered.slice(first, stop - first)
    return divided


def _ports_of(file: PartFile, index: int, *, is_sealed: bool) -> list[PortKey]:
    if is_sealed:  # a footer that nothing vouches for is not asked: pyarrow may abort
        stations, ports = (file.bounds(column)[index] for column in KEY)
        if stations and ports and stations[0] == stations[1] and ports[0] == ports[1]:
            return [(stations[0], ports[0])]
    return [*split_by_port(group_of(file, SORTED, index, KEY))]


def _bytes_of(divided: dict[PortKey, pa.Table]) -> int:
    return sum(int(rows.nbytes) for rows in divided.values())
