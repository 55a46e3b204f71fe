"""The setpoint in force in each row of the samples, as verdict, joints and metrics take it
(`setting_in_force`): the one last read from this port, for at most `SETTING_HOLDS_S`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, cast

import numpy as np
import pandas as pd

from jbclog.analysis.clock_steps import Step
from jbclog.analysis.port_data import (
    SETTING_HOLDS_S,
    seconds_of,
    setting_in_force,
    without_steps,
)

SETPOINT: Final = "setpoint_c"
NEEDED: Final = ("time", "tick", "station", "port", SETPOINT)
BEFORE: Final = pd.Timedelta(seconds=2 * SETTING_HOLDS_S)
"""How much earlier than a selection rows are read; twice, as a late row is stamped later."""


def with_setpoint_in_force(
    rows: pd.DataFrame, periods: Mapping[str, float | None], steps: Sequence[Step], t0_us: int
) -> pd.DataFrame:
    """Return rows of the samples, which have `NEEDED`, with the setpoint in force in each.

    `periods`: seconds between the ticks of each station, None without a grid. `steps`: those that
    the times of the run follow. `t0_us`: zero of the run's time.
    """
    read = rows[SETPOINT].to_numpy(dtype=np.float64, na_value=np.nan)
    in_force = np.full(len(rows), np.nan)
    ticks = rows["tick"].to_numpy(dtype=np.float64)
    times_us = np.asarray(rows["time"].astype("int64"), dtype=np.int64)
    for place, own in rows.groupby(["station", "port"], sort=False).indices.items():
        station = str(cast(tuple[object, object], place)[0])
        steady_us = without_steps(times_us[own], steps)
        seconds = seconds_of(periods.get(station), ticks[own], steady_us, t0_us)
        in_force[own] = setting_in_force(seconds, read[own])
    filled = pd.Series(in_force, index=rows.index).astype(rows[SETPOINT].dtype)
    return rows.assign(**{SETPOINT: filled})
