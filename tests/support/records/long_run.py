"""A sealed run of one port of any length, made while it is read: a tip that is soldered with, again
and again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from jbclog.analysis.run import Run
from jbclog.analysis.run_tables import frame, select
from jbclog.core.rows import PortKey, StationFacts
from jbclog.record.manifest import Manifest
from jbclog.record.samples_by_port import SamplesByPort
from jbclog.record.schema import SCHEMAS
from support.plants.scripted_tip import soldered

T0_US = 1_790_000_000_000_000
RECORD_HZ = 10.0
GROUP = 10_000
PAUSE_S = 6.0
LATE_US, FIRST_LATE_US, SCAN_US = 44_000, 60_000, 4000


@cache
def record_of_ten_minutes() -> dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    rows = soldered(
        [(15 + PAUSE_S * n, 16.2 + PAUSE_S * n) for n in range(97)], 600.0, hz=RECORD_HZ
    ).rows
    return {
        "temperature_c": rows.temperature,
        "power_permille": rows.power,
        "setpoint_c": rows.setting,
    }


class LongRun(Run):
    """`seconds` of a station at `hz`, its answers some milliseconds late, the first one more;
    `is_free`: with ``--rate max``, its rows some milliseconds beside the grid.
    """

    def __init__(
        self,
        seconds: float,
        hz: float,
        family: str = "dde",
        is_free: bool = False,
        group: int = GROUP,
    ) -> None:
        super().__init__(Path("made while it is read"))
        self.rows, self.hz, self.is_free, self.group = round(seconds * hz), hz, is_free, group
        signals = ["external_c"] if family == "jtse" else []
        facts = StationFacts(
            "dde-1",
            "sim://",
            family,
            ports=[1],
            period_s=None if is_free else 1 / hz,
            rated_power_w=130.0,
        )
        facts.signals = signals
        self._manifest = Manifest("long", state="sealed", t0_utc=T0_US / 1e6, stations=[facts])

    @property
    def manifest(self) -> Manifest:
        return self._manifest

    def groups(self, table: str, columns: list[str], **_: object) -> Iterator[pa.Table]:
        return iter([] if table == "events" else self.pieces_of(columns))

    def pieces_of(self, columns: Sequence[str]) -> Iterator[pa.Table]:
        for first in range(0, self.rows, self.group):
            ticks = np.arange(first, min(first + self.group, self.rows))
            yield self._rows(ticks).select(list(columns))

    def samples_by_port(self, columns: Sequence[str]) -> SamplesByPort:
        return MadeSamples(self, columns)

    def settings(self, station: str | None = None) -> pd.DataFrame:
        return frame(SCHEMAS["settings"].empty_table())

    def events(self, *_: object) -> pd.DataFrame:
        return frame(SCHEMAS["events"].empty_table())

    def counters(self, station: str | None = None) -> pd.DataFrame:
        return frame(SCHEMAS["counters"].empty_table())

    def samples(self, *_: object, **__: object) -> pd.DataFrame:
        raise AssertionError("all samples at once")

    def _rows(self, ticks: np.ndarray[tuple[int], np.dtype[np.int64]]) -> pa.Table:
        record, times = record_of_ten_minutes(), ticks / self.hz * 1e6 + T0_US
        length = len(record["setpoint_c"])
        place = np.round(ticks * RECORD_HZ / self.hz).astype(np.int64)
        # one heat-up
        place = np.where(place < length, place, length // 2 + (place - length) % (length // 2))
        beside = 3000 * (ticks % 7)
        late_us = np.where(ticks == 0, FIRST_LATE_US, LATE_US) + beside // 6
        known: dict[str, object] = {name: column[place] for name, column in record.items()}
        known |= {
            "tick": ticks,
            "late_us": late_us,
            "scan_us": np.full(len(ticks), SCAN_US),
            "time": (times + (beside if self.is_free else late_us + SCAN_US / 2)).astype(np.int64),
        }
        known |= {
            "station": ["dde-1"] * len(ticks),
            "port": np.ones(len(ticks), np.int64),
            "status": ["working"] * len(ticks),
        }
        columns = select("samples").columns
        schema = SCHEMAS["samples"]
        made = [
            (
                pa.array(known[name], from_pandas=True).cast(schema.field(name).type)
                if name in known
                else pa.nulls(len(ticks), schema.field(name).type)
            )
            for name in columns
        ]
        return pa.table(made, names=list(columns))


class MadeSamples(SamplesByPort):
    def __init__(self, run: LongRun, columns: Sequence[str]) -> None:
        super().__init__(columns, [], order=[(run.stations[0].name, 1)])
        self._run = run

    def rows(self, key: PortKey, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        return self._run.pieces_of(self.columns if columns is None else columns)
