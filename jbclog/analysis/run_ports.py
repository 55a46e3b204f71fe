"""The ports of a run, each with its rows (`PortData`)."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

from jbclog.analysis.clock_steps import steps_in
from jbclog.analysis.port_data import ANSWERED, CODES, COLUMNS, PortData, column_of, port_data
from jbclog.analysis.run_tables import RunTables
from jbclog.core.rows import SIGNAL_COLUMNS, SIGNAL_OF_COLUMN, PortKey, StationFacts
from jbclog.record.clock_steps import COLUMNS as STEP_COLUMNS
from jbclog.record.ledger import SAMPLE_COLUMNS, SIGNALS, ledger_in
from jbclog.record.manifest import Ledger

EVERY_COLUMN: Final = (*ANSWERED, "quality", *SIGNAL_COLUMNS)


class RunPorts:
    """The ports of a run in the order of the line file. A port is read when it is asked for, so
    that one is in memory at a time.
    """

    def __init__(self, run: RunTables, columns: Sequence[str] = ()) -> None:
        """`columns` are those of `samples` that `PortData` has besides its own."""
        manifest = run.manifest
        self._is_sealed = manifest.is_sealed
        self._t0_us = manifest.t0_utc_us
        self._columns = columns
        self._stations = {facts.name: facts for facts in run.stations}
        self._steps = steps_in(run.groups("events", STEP_COLUMNS))
        ledger = manifest.ledger
        if not manifest.is_sealed:
            ledger = ledger_in(run.groups("samples", SAMPLE_COLUMNS), (), run.stations)
        self._every_tick = every_tick(ledger)
        wanted = ["time", "tick", *COLUMNS, *CODES, *columns]
        self._samples = run.samples_by_port(list(dict.fromkeys(wanted)))

    @property
    def keys(self) -> Sequence[PortKey]:
        return self._samples.ports

    def __getitem__(self, key: PortKey) -> PortData:
        """Return the rows of a port, none if it has no rows. Raises `RecordError`."""
        return self.read(key, self._columns)

    def read(self, key: PortKey, columns: Sequence[str] = ()) -> PortData:
        """Return the rows of a port with some of the columns only. Raises `RecordError`."""
        station, port = key
        facts = self._stations.get(station) or StationFacts(station, "", "")
        return port_data(
            self._samples,
            facts,
            port,
            self._t0_us,
            columns=columns,
            steps=self._steps,
            every_tick=self._every_tick.get(key, ()),
            # the last rows of an open run may not be committed yet
            last_tick=facts.last_tick if self._is_sealed else None,
        )

    def with_column(self, data: PortData, name: str) -> PortData:
        """Return rows that were read whole with one column instead of those besides `COLUMNS`, so
        that one is in memory at a time. Raises `RecordError`.
        """
        if name in COLUMNS:
            return data
        columns = {own: data.columns[own] for own in COLUMNS}
        columns[name] = column_of(self._samples, data.key, name)
        return replace(data, columns=columns)

    def __iter__(self) -> Iterator[PortData]:
        return map(self.__getitem__, self.keys)


def columns_of(facts: StationFacts) -> list[str]:
    """Return the columns that a station may have values in; all if its signals are not known."""
    if not facts.signals:
        return [*EVERY_COLUMN]
    signals = [name for name in SIGNAL_COLUMNS if SIGNAL_OF_COLUMN[name] in facts.signals]
    return [*ANSWERED, "quality", *signals]


def every_tick(ledger: Ledger) -> Mapping[PortKey, Collection[str]]:
    """Return the signals of each port that are read at every tick: no signal was due more often."""
    often: dict[PortKey, frozenset[str]] = {}
    for station, ports in ledger.items():
        for port, signals in ports.items():
            due = {name: counts["due"] for name, counts in signals.items() if name in SIGNALS}
            most = max(due.values(), default=0)
            if port.isdigit():
                names = [name for name, count in due.items() if count == most]
                often[station, int(port)] = frozenset(names)
    return often
