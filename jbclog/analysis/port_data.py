"""The rows of one port of a run as arrays, made once from the sorted samples.

1. A row has two times in the run. `seconds` is when it was due on the run's grid: tick × period. It
   was read at `time_us`, which is UTC by the run's own clock. Without a grid both are the same.
2. A value that was not read is NaN. Readings are whole numbers of at most seven digits, which
   float32 holds exactly. A text that was not read has the code -1.
3. `columns` has columns of `samples` as they were read. `setpoint` is the one in force: the one
   last read, for at most `SETTING_HOLDS_S`. `in_place`: the tool was in its port, which worked.
4. `gaps` gives the gaps of a signal with their reasons (`gaps.py`).
5. A slice shares the arrays of the whole, and so keeps what rows outside of it decided about
   setpoint and place. Its gaps are those of its own rows, open at both edges.

The times of runs of 0.1.0 follow the steps of their host's clock; `steady_us` has them corrected.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from jbclog.analysis.clock_steps import Step, Unstepped
from jbclog.analysis.gaps import PortClock, SignalGaps, in_order, why
from jbclog.core.errors import UsageError
from jbclog.core.rows import PortKey, StationFacts
from jbclog.record.samples_by_port import SamplesByPort
from jbclog.record.schema import SCHEMAS, TIME

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]
Readings = NDArray[np.float32]
Codes = NDArray[np.floating[Any]]
Kind = TypeVar("Kind", bound=np.floating[Any])

TEMPERATURE: Final = "temperature_c"
POWER: Final = "power_permille"
SETPOINT: Final = "setpoint_c"
STATUS: Final = "status"
REASONS: Final = "reasons"
ANSWERED: Final = ("late_us", "scan_us")
CODES: Final = ("tool", "port_error")
COLUMNS: Final = (TEMPERATURE, POWER, SETPOINT, STATUS, REASONS)
"""The columns that `PortData.columns` always has."""

WORKING: Final = ("working", "on")
"""Status of a tool that works; the second of hot air."""
WITHOUT_TIP: Final = ("jtse", "omega")  # families
WORKS: Final = (0.0, 9.0)
"""Port errors with which a port works: none; a warning of overload (manuals 000 and 002)."""
SETTING_HOLDS_S: Final = 15.0
"""The setpoint is due every 5 s; two lost readings are bridged."""


@dataclass(frozen=True, slots=True, eq=False)
class Texts:
    """A column of texts: for each row the number of its text among `words`, -1 where not read."""

    codes: NDArray[np.signedinteger[Any]]
    words: Sequence[str]

    def __getitem__(self, rows: slice) -> Texts:
        return Texts(self.codes[rows], self.words)

    @property
    def is_read(self) -> Flags:
        return self.codes >= 0

    def is_among(self, words: Collection[str]) -> Flags:
        """Return in which rows the text is one of these."""
        numbers = [number for number, word in enumerate(self.words) if word in words]
        return np.isin(self.codes, numbers)

    def arrow(self) -> pa.DictionaryArray:
        """Return the column as Arrow's dictionary, null where not read."""
        codes = pa.array(self.codes, pa.int32(), mask=self.codes < 0)
        return pa.DictionaryArray.from_arrays(codes, pa.array(self.words, pa.utf8()))


Column = Readings | Texts


@dataclass(frozen=True, slots=True, eq=False)
class PortData:
    """The rows of one port as arrays, in order; ``data[first:stop]`` shares them.

    - `t0_us`: zero of the run's seconds, UTC µs
    - `ticks`, `time_us`: tick of each row, and when it was read (UTC µs by the run's clock);
      `steady_us`: the same, in runs of 0.1.0 without the steps of their host's clock
    - `columns`: columns of the samples by name: readings (°C, ‰, codes; flags are 0 and 1) as
      float32, NaN where not read, and texts
    - `setpoint`: the one in force, °C: the one last read, for at most 15 s
    - `in_place`: the tool was in its port, and the port worked
    - `every_tick`: signals that are due at every tick, and so at ticks without a row
    - `first_tick`, `last_tick`: the first and the last one at which the port was due, where known
    """

    facts: StationFacts
    port: int
    t0_us: int
    ticks: NDArray[np.signedinteger[Any]]
    time_us: Counts
    steady_us: Counts
    columns: Mapping[str, Column]
    setpoint: Readings
    in_place: Flags
    every_tick: Collection[str] = ()
    first_tick: int | None = None
    last_tick: int | None = None

    @property
    def key(self) -> PortKey:
        """Station and port."""
        return self.facts.name, self.port

    def __len__(self) -> int:
        return len(self.ticks)

    def __repr__(self) -> str:
        return f"<PortData {self.facts.name} port {self.port}: {len(self)} rows>"

    @property
    def period_s(self) -> float | None:
        """Seconds between two ticks; None without a grid."""
        return self.facts.period_s or None

    @property
    def seconds(self) -> Floats:
        """When each row was due, in s of the run; without a grid when it was read."""
        return seconds_of(self.period_s, self.ticks, self.steady_us, self.t0_us)

    @property
    def read_s(self) -> Floats:
        """When each row was read, in s of the run, never falling.

        On a grid each answer came between the first question of its row and the last answer to it,
        and these are by the monotonic clock. A row without a question was read when it was due.
        """
        seconds = self.seconds
        if self.period_s is None:
            return seconds
        late_us, scan_us = (self._numbers(name).astype(np.float64) for name in ANSWERED)
        earliest = np.nan_to_num(late_us) / 1e6
        latest = earliest + np.nan_to_num(scan_us) / 1e6
        later = np.clip((self.time_us - self.t0_us) / 1e6 - seconds, earliest, latest)
        return np.asarray(np.maximum.accumulate(seconds + later), dtype=np.float64)

    @property
    def temperature(self) -> Readings:
        """°C, NaN where not read."""
        return self._numbers(TEMPERATURE)

    @property
    def power(self) -> Readings:
        """‰ of the station's full-scale power, NaN where not read."""
        return self._numbers(POWER)

    @property
    def setpoint_read(self) -> Readings:
        """The setpoint in the rows in which it was read, °C."""
        return self._numbers(SETPOINT)

    @property
    def status(self) -> Texts:
        """The tool's status as read."""
        return self._texts(STATUS)

    @property
    def working(self) -> Flags:
        """The rows in which the tool works, by its status."""
        return self.status.is_among(WORKING)

    def is_read(self, name: str) -> Flags:
        """Return in which rows a column was read. Raises `UsageError` if it is not in `columns`."""
        column = self._column(name)
        return column.is_read if isinstance(column, Texts) else ~np.isnan(column)

    def gaps(self, signal: str = TEMPERATURE) -> SignalGaps:
        """Return the gaps of a signal. Raises `UsageError` if it is not in `columns`."""
        clock = PortClock((self.period_s or 0.0) * 1e6, self.first_tick)
        times_us = clock.never_back(self.steady_us)
        places, without_rows = clock.without_rows(times_us, self.ticks.astype(np.int64))
        after = clock.after(self.last_tick)
        named = why(self._texts(REASONS).arrow(), [signal])
        rows = np.flatnonzero(named.codes >= 0)
        missing = named.missing(times_us, rows)
        gaps = SignalGaps()
        if signal in self.every_tick:
            missing = in_order(rows, missing, places, without_rows)
        gaps.add(times_us, self.is_read(signal), missing)
        if signal in self.every_tick:
            gaps.end(after)
        else:
            gaps.end()
        return gaps

    def __getitem__(self, rows: slice) -> PortData:
        """Return these rows, without a copy."""
        return replace(
            self,
            ticks=self.ticks[rows],
            time_us=self.time_us[rows],
            steady_us=self.steady_us[rows],
            columns={name: column[rows] for name, column in self.columns.items()},
            setpoint=self.setpoint[rows],
            in_place=self.in_place[rows],
            first_tick=None,
            last_tick=None,
        )

    def between(self, start_s: float, stop_s: float) -> PortData:
        """Return the rows from `start_s` to before `stop_s`, in s of the run, without a copy."""
        first, stop = np.searchsorted(self.seconds, [start_s, stop_s])
        return self[int(first) : int(stop)]

    def frame(self) -> pd.DataFrame:
        """Return the rows as a table: `time` (UTC), `tick`, `seconds`, the columns, `in_place`.

        `setpoint_c` is the setpoint in force, `setpoint_read_c` that of the rows in which it was
        read.
        """
        table = {
            "time": pa.array(self.time_us).cast(TIME),
            "tick": pa.array(self.ticks),
            "seconds": pa.array(self.seconds),
        }
        for name, column in self.columns.items():
            table[name] = column.arrow() if isinstance(column, Texts) else pa.array(column)
        table["setpoint_read_c"] = table[SETPOINT]
        table[SETPOINT] = pa.array(self.setpoint)
        table["in_place"] = pa.array(self.in_place)
        frame: pd.DataFrame = pa.table(table).to_pandas()
        return frame

    def plot(self) -> Figure:
        """Draw temperature, setpoint, power, status and gaps, over days (UTC).

        `Run.plot` draws alarms, limits and joints, too. Raises `UsageError` without a row.
        """
        from jbclog.analysis.port_figure import figure_of

        return figure_of(self)

    def _column(self, name: str) -> Column:
        if name not in self.columns:
            raise UsageError(f"{name!r} was not read; there are {', '.join(self.columns)}")
        return self.columns[name]

    def _numbers(self, name: str) -> Readings:
        column = self._column(name)
        if isinstance(column, Texts):
            raise UsageError(f"{name!r} has texts, no numbers")
        return column

    def _texts(self, name: str) -> Texts:
        column = self._column(name)
        if not isinstance(column, Texts):
            raise UsageError(f"{name!r} has numbers, no texts")
        return column


def port_data(
    samples: SamplesByPort,
    facts: StationFacts,
    port: int,
    t0_us: int,
    *,
    columns: Sequence[str] = (),
    steps: Sequence[Step] = (),
    every_tick: Collection[str] = (),
    last_tick: int | None = None,
) -> PortData:
    """Return the rows of a port.

    `columns` are read besides `COLUMNS`; `samples` have all of them, `time`, `tick` and `CODES`.
    `steps` are those that the times of the run follow. Raises `RecordError`.
    """
    names = list(dict.fromkeys([*COLUMNS, *columns]))
    schema = SCHEMAS["samples"]
    times, ticks = [np.empty(0, np.int64)], [np.empty(0, np.int32)]
    numbers: dict[str, list[Readings]] = {}
    texts: dict[str, list[Texts]] = {}
    for name in dict.fromkeys([*names, *CODES]):
        if pa.types.is_string(schema.field(name).type):
            texts[name] = []
        else:
            numbers[name] = [np.empty(0, np.float32)]
    for rows in samples.rows((facts.name, port), ["time", "tick", *numbers, *texts]):
        times.append(rows["time"].cast(pa.int64()).to_numpy())
        ticks.append(rows["tick"].cast(pa.int32()).to_numpy())
        for name, readings in numbers.items():
            readings.append(_readings(rows[name]))
        for name, pieces in texts.items():
            pieces.append(_texts(rows[name]))
    time_us = np.concatenate(times)
    steady_us = without_steps(time_us, steps)
    tick = np.concatenate(ticks)
    seconds = seconds_of(facts.period_s, tick, steady_us, t0_us)
    read = {name: np.concatenate(readings) for name, readings in numbers.items()}
    words = {name: _joined(pieces) for name, pieces in texts.items()}
    tool, port_error = (read[name] for name in CODES)
    if not has_tip(facts):  # hot air has other codes, none of which is considered
        port_error = np.full_like(tool, np.nan)
    return PortData(
        facts,
        port,
        t0_us,
        tick,
        time_us,
        steady_us,
        {name: words[name] if name in words else read[name] for name in names},
        setting_in_force(seconds, read[SETPOINT]),
        in_place(tool, port_error),
        every_tick,
        facts.first_tick,
        last_tick,
    )


def column_of(samples: SamplesByPort, key: PortKey, name: str) -> Column:
    """Return a column of a port's rows. Raises `RecordError`."""
    pieces = [rows[name] for rows in samples.rows(key, [name])]
    if pa.types.is_string(SCHEMAS["samples"].field(name).type):
        return _joined([_texts(piece) for piece in pieces])
    return np.concatenate([np.empty(0, np.float32), *map(_readings, pieces)])


def without_steps(time_us: Counts, steps: Sequence[Step]) -> Counts:
    """Return the times of a port's rows, in order, corrected for the steps that they follow."""
    if not steps:
        return time_us
    return np.rint(Unstepped(steps).of(time_us / 1e6) * 1e6).astype(np.int64)


def seconds_of(
    period_s: float | None, ticks: NDArray[Any], steady_us: Counts, t0_us: int
) -> Floats:
    """Return the seconds of rows: on a grid from their ticks, else from their times."""
    if period_s:
        return ticks * period_s
    return (steady_us - t0_us) / 1e6


def has_tip(facts: StationFacts) -> bool:
    """Return whether joints show in its signals: hot air and OMEGA have no tip."""
    return facts.family not in WITHOUT_TIP


def setting_in_force(seconds: Floats, setting: NDArray[Kind]) -> NDArray[Kind]:
    """Return the setpoint last read in each row, for at most `SETTING_HOLDS_S`; NaN: not known."""
    held, read = np.full_like(setting, np.nan), np.flatnonzero(~np.isnan(setting))
    if len(read):  # it is read every few seconds, so that this is faster than a search in each row
        rows, known = np.diff(read, append=len(setting)), held[read[0] :]
        known[:] = np.repeat(setting[read], rows)
        known[seconds[read[0] :] - np.repeat(seconds[read], rows) > SETTING_HOLDS_S] = np.nan
    return held


def in_place(tool: Codes, port_error: Codes) -> Flags:
    """Return the rows of one port in which the tool was in its port and the port worked. Codes are
    NaN where not read.

    Tool and port error are read every few seconds, temperature many times a second. So a row counts
    only if the readings before and after it agree: the same tool, and a port that works (`WORKS`;
    hot air has other codes, none of which is considered). With a reading on one side only, that one
    decides; without any reading the row counts.
    """
    if _is_never_changed(tool) and _works(port_error[~np.isnan(port_error)]).all():
        return np.ones(len(tool), dtype=np.bool_)  # the usual case, ten times as fast
    before, after = _neighbours(tool)
    is_same = np.isnan(before) | np.isnan(after) | (before == after)
    works = _is_good(tool, tool > 0) & _is_good(port_error, _works(port_error))
    return np.asarray(is_same & works, dtype=np.bool_)


def _works(port_error: Codes) -> Flags:
    works, warns = WORKS
    return np.asarray((port_error == works) | (port_error == warns), dtype=np.bool_)


def _is_never_changed(tool: Codes) -> bool:
    read = tool[~np.isnan(tool)]
    return not len(read) or bool(read[0] > 0 and (read == read[0]).all())


def _is_good(codes: Codes, good: Flags) -> Flags:
    before, after = _neighbours(np.where(np.isnan(codes), np.nan, good.astype(np.float64)))
    # also for NaN, where nothing was read
    return np.asarray((before != 0.0) & (after != 0.0), dtype=np.bool_)


def _neighbours(codes: Codes) -> tuple[Floats, Floats]:
    """Return the last code read up to each row, and the first from it on; NaN without one."""
    return _held(codes), _held(codes[::-1])[::-1]


def _held(codes: Codes) -> Floats:
    last = np.maximum.accumulate(np.where(np.isnan(codes), -1, np.arange(len(codes))))
    return np.asarray(np.where(last >= 0, codes[last], np.nan), dtype=np.float64)


def _readings(column: pa.ChunkedArray) -> Readings:
    return np.asarray(column.cast(pa.float32(), safe=False).to_numpy(), dtype=np.float32)


def _texts(column: pa.ChunkedArray) -> Texts:
    coded = column.combine_chunks().dictionary_encode()
    codes = pc.fill_null(coded.indices, -1).to_numpy()
    words = coded.dictionary.to_pylist()
    return Texts(codes.astype(_kind_of_codes(words)), words)


def _joined(pieces: Sequence[Texts]) -> Texts:
    """Return one column with the words of all pieces."""
    numbers: dict[str, int] = {}
    for piece in pieces:
        for word in piece.words:
            numbers.setdefault(word, len(numbers))
    kind = _kind_of_codes(numbers)
    codes = [np.empty(0, kind)]
    for piece in pieces:
        number_of = np.array([*(numbers[word] for word in piece.words), -1], dtype=kind)
        codes.append(number_of[piece.codes])
    return Texts(np.concatenate(codes), list(numbers))


def _kind_of_codes(words: Collection[str]) -> np.dtype[Any]:
    """Return the narrowest type that holds the numbers of these words, and -1."""
    return np.min_scalar_type(-max(len(words), 1))
