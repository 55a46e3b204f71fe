"""The gaps of a run as a table: a row for each gap of each signal of each port (`gaps.py`).

Also of a run that is being recorded: of the rows that are committed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.derived_schemas import GAPS_SCHEMA
from jbclog.analysis.gaps import Gap
from jbclog.analysis.run_ports import RunPorts
from jbclog.analysis.run_tables import UNTIL, RunTables, frame
from jbclog.core.errors import UsageError
from jbclog.core.rows import PortKey
from jbclog.record.ledger import SIGNALS
from jbclog.record.schema import FLAG, FLOAT, INT, TEXT, TIME


def gaps_of(
    run: RunTables, station: str | None = None, port: int | None = None, signal: str | None = None
) -> pd.DataFrame:
    """Return the gaps as `Run.gaps` describes them. Raises `UsageError` and `RecordError`."""
    run.expect_place(station, port)
    if signal is not None and signal not in SIGNALS:
        raise UsageError(f"there is no signal {signal!r}; there are {', '.join(SIGNALS)}")
    table, until_us = _table(run, station, port, SIGNALS if signal is None else (signal,))
    gaps = frame(table)
    if not run.manifest.is_sealed and until_us is not None:
        gaps.attrs[UNTIL] = pd.Timestamp(until_us, unit="us", tz="UTC")
    return gaps


def gap_rows(run: RunTables) -> pa.Table:
    """Return all gaps of a run, with `GAPS_SCHEMA`, by station, port, signal and time. Raises
    `RecordError`.
    """
    table, _ = _table(run, None, None, SIGNALS)
    return table


def _table(
    run: RunTables, station: str | None, port: int | None, signals: Sequence[str]
) -> tuple[pa.Table, int | None]:
    """Return the gaps, and the time of the last row in µs."""
    ports = RunPorts(run, SIGNALS)
    pieces = [GAPS_SCHEMA.empty_table()]
    until_us: int | None = None
    for key in ports.keys:
        if station not in (None, key[0]) or port not in (None, key[1]):
            continue
        data = ports.read(key)
        if not len(data):
            continue
        until_us = max(int(data.steady_us[-1]), until_us or 0)
        for signal in signals:
            gaps = ports.with_column(data, signal).gaps(signal)
            pieces.append(_rows(run.manifest.run, key, signal, gaps))
    return pa.concat_tables(pieces), until_us


def _rows(run: str, key: PortKey, signal: str, gaps: Iterable[Gap]) -> pa.Table:
    listed = [*gaps]
    count = len(listed)
    starts = pa.array([gap.start_us for gap in listed], INT)
    stops = pa.array([gap.stop_us for gap in listed], INT)
    columns = [
        pa.array([run] * count, TEXT),
        pa.array([key[0]] * count, TEXT),
        pa.array([key[1]] * count, INT),
        pa.array([signal] * count, TEXT),
        starts.cast(TIME),
        stops.cast(TIME),
        pc.divide(pc.subtract(stops, starts).cast(FLOAT), 1e6),
        pa.array([gap.missing for gap in listed], INT),
        pa.array([gap.reasons_text for gap in listed], TEXT),
        pa.array([gap.at_least for gap in listed], FLAG),
    ]
    return pa.Table.from_arrays(columns, schema=GAPS_SCHEMA)
