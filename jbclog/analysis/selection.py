"""What is asked of a table: which station, port, time and columns; and how that is cut out of some rows."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, cast

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.errors import RecordError, UsageError
from jbclog.core.foreign.tables import bounds_of
from jbclog.record.schema import SCHEMAS

Moment = str | datetime | pd.Timestamp
"""A time: a string such as ``2026-11-21T01:30``, a datetime or a Timestamp; UTC where it names no zone."""

MICROSECONDS: Final = struct.Struct("<q")  # a time as Parquet writes one plainly


@dataclass(frozen=True, slots=True)
class Asked:
    """`start` is included, `stop` is not, both UTC; None asks for all."""

    table: str
    columns: Sequence[str]
    station: str | None = None
    port: int | None = None
    start: pd.Timestamp | None = None
    stop: pd.Timestamp | None = None

    @property
    def needed(self) -> list[str]:
        """The columns that have to be read for it, in their order."""
        beside = {"station": self.station, "port": self.port, "time": self.start if self.start is not None else self.stop}
        also = {name for name, value in beside.items() if value is not None}
        return [name for name in SCHEMAS[self.table].names if name in {*self.columns, *also}]

    def cut(self, rows: pa.Table) -> pa.Table:
        """Those of `rows` that are asked for, in the columns' order."""
        if self.station is not None:
            rows = rows.filter(pc.equal(rows["station"], self.station))
        if self.port is not None:
            rows = rows.filter(pc.equal(rows["port"], self.port))
        if self.start is not None:
            rows = rows.filter(pc.greater_equal(rows["time"], _scalar(self.start)))
        if self.stop is not None:
            rows = rows.filter(pc.less(rows["time"], _scalar(self.stop)))
        return rows.select(list(self.columns))

    def may_have(self, part: Path) -> bool:
        """Whether a part can have rows of the time asked for, by its footer. Raises `RecordError` where it has none."""
        if self.start is None and self.stop is None:
            return True
        try:
            first, last = _span(part)
        except (pa.ArrowException, OSError) as error:
            raise RecordError(f"{part} is no readable part: {error}") from error
        if first is None or last is None:
            return True
        return (self.start is None or last >= self.start) and (self.stop is None or first < self.stop)


def asked(
    table: str,
    columns: Sequence[str] | None = None,
    station: str | None = None,
    port: int | None = None,
    start: Moment | None = None,
    stop: Moment | None = None,
) -> Asked:
    """What somebody asks for. Raises `UsageError` for a column that there is not."""
    names = SCHEMAS[table].names
    unknown = [name for name in columns or () if name not in names]
    if unknown:
        raise UsageError(f"{table} has no column {', '.join(unknown)}; it has {', '.join(names)}")
    return Asked(table, list(columns) if columns is not None else names, station, port, utc(start), utc(stop))


def utc(moment: Moment | None) -> pd.Timestamp | None:
    """A time in UTC, which it is taken to be where it names no zone."""
    if moment is None:
        return None
    stamp = pd.Timestamp(moment)
    return stamp.tz_localize(UTC) if stamp.tzinfo is None else stamp.tz_convert(UTC)


def frame(table: pa.Table) -> pd.DataFrame:
    """An Arrow table as a DataFrame: Int64 and boolean where values can be missing, times in UTC."""
    return cast(pd.DataFrame, table.to_pandas())


def _scalar(stamp: pd.Timestamp) -> pa.Scalar:
    return pa.scalar(stamp.as_unit("ns").value // 1000, pa.int64()).cast(pa.timestamp("us", tz="UTC"))


def _span(part: Path) -> tuple[pd.Timestamp | None, pd.Timestamp | None]:
    """The first and the last time in a part; None where its footer does not say. Raises OSError or pa.ArrowException."""
    seen = bounds_of(part, "time")
    if not seen or any(one is None or {*map(len, one)} != {MICROSECONDS.size} for one in seen):
        return None, None
    try:
        times = [pd.Timestamp(MICROSECONDS.unpack(plain)[0], unit="us", tz=UTC) for one in seen if one is not None for plain in one]
    except (ValueError, OverflowError):  # a time that no clock shows
        return None, None
    return min(times), max(times)
