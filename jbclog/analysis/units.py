"""Which unit was on the bench at a moment (`record/annotations.py` says whose joints are whose)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from jbclog.record.annotations import BEGIN, END, late_serials, only_unit

if TYPE_CHECKING:
    from jbclog.analysis.run import Run

Times = Sequence[object] | pd.Series | pd.DatetimeIndex
"""UTC moments: Timestamps, datetimes, or strings with a zone."""


def unit_at(run: Run, times: Times) -> pd.Series:
    """The serial of the unit at each of `times`, in their order; missing where none is known. An index of `times` is kept."""
    index = times.index if isinstance(times, pd.Series) else None
    micros = _micros(pd.Series(times, index=index))
    manifest, events = run.manifest, run.events()
    told = events[events["kind"].isin([BEGIN, END])]
    if not (told["kind"] == BEGIN).any():
        late = late_serials(run.folder) if manifest.state == "sealed" else []
        return pd.Series(only_unit(manifest.metadata.units, late), index=micros.index, dtype="string")
    units = np.array([None, *told["raw"].where(told["kind"] == BEGIN, None)], dtype=object)  # the first: before any of them
    places = np.searchsorted(_micros(told["time"]).to_numpy(), micros.to_numpy(), side="right")
    return pd.Series(units[places], index=micros.index, dtype="string")


def _micros(times: pd.Series) -> pd.Series:
    return pd.to_datetime(times, utc=True).dt.as_unit("us").astype("int64")
