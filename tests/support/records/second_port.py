"""Three minutes of the second port of `profiles/lines/bench.toml`'s second two-port station, as
recorded: it solders for 2.0 s again and again, and its first reading is 16 ms later than the rest.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Final

import numpy as np

from jbclog.analysis.joints.port_rows import Clock
from jbclog.analysis.joints.series import Series
from jbclog.analysis.verdict.idle import Block

RECORDED: Final = Path(__file__).parents[2] / "data" / "joints" / "second_port_of_bench.csv"
PERIOD_S, RATED_W, DWELL_S, JOINTS = 0.2, 130.0, 2.0, 24


def second_port() -> Series:
    with RECORDED.open(newline="") as file:
        rows = list(csv.DictReader(file))
    columns = {
        name: np.array([float(row[name] or "nan") for row in rows], dtype=np.float64)
        for name in rows[0]
    }
    clock = Clock(PERIOD_S, (), 0)
    utc_us = columns["after_t0_us"].astype(np.int64)
    seconds = clock.seconds(columns["tick"], utc_us)
    working = np.ones(len(seconds), dtype=np.bool_)
    block = Block(
        seconds, columns["temperature_c"], columns["power_permille"], columns["setpoint_c"], working
    )
    read_s = clock.read_s(seconds, utc_us, columns["late_us"], columns["scan_us"])
    return Series(block, working, PERIOD_S, rated_w=RATED_W, read_s=read_s)
