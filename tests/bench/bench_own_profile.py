"""The main use case of jbclog: two ports, three fast signals, all slow ones and the counters at 10
Hz, with a response time of 1 ms.

The six fast reads of a tick take 90 of its 100 ms on this link; everything else shares the rest.
For ten minutes no tick may be skipped, and no slow signal may exceed its maximum age.
"""

from __future__ import annotations

import sys

import bare
from common import (
    HZ,
    READ_S,
    Claim,
    at_most,
    bytes_allow,
    in_own_process,
    is_short,
    judge,
    show,
    virtual_stations,
)
from recorder import Recorded, record

from jbclog.session.scheduler import CEILING

TURNAROUND_MS = 1.0
BARE_S = 3.0
COLUMNS = ("", "exchanges", "a second", "CPU µs", "late ms 50 %", "99 %", "latest", "skipped")


def main() -> int:
    seconds = 30.0 if is_short(__doc__) else 600.0
    with virtual_stations(1, ports="[1, 2]", turnaround_ms=TURNAROUND_MS) as station:
        loop = in_own_process(bare.loop, station.ports[0], BARE_S)
        ours = in_own_process(record, station.line, station.recipe(), station.folder, seconds)
    loop_row = [
        "bare pyserial loop, no pause",
        loop.exchanges,
        loop.exchanges / loop.seconds,
        loop.cpu_us,
        "",
        "",
        "",
        "",
    ]
    show(f"two ports, 10 Hz, 1 ms of turnaround, {seconds:g} s", COLUMNS, [loop_row, _row(ours)])
    least_s = READ_S + TURNAROUND_MS / 1000
    return judge([*_claims(ours, seconds), bytes_allow("bare loop", loop.shortest_s, least_s)])


def _row(ours: Recorded) -> list[object]:
    return [
        "jbclog",
        ours.exchanges,
        ours.exchanges / ours.seconds,
        ours.cpu_us,
        *ours.late_ms,
        ours.ticks_skipped,
    ]


def _claims(ours: Recorded, seconds: float) -> list[Claim]:
    rows = round(seconds * HZ) * 2
    return [
        Claim(
            "no tick skipped",
            ours.ticks_skipped == 0 and ours.rows == rows,
            f"{ours.ticks_skipped}, {ours.rows} of {rows} rows",
        ),
        at_most(
            "the longest that a slow signal waited, in its periods",
            ours.worst_slow_periods,
            CEILING,
        ),
        bytes_allow(
            "jbclog: three reads of a row",
            ours.shortest_scan_s,
            3 * (READ_S + TURNAROUND_MS / 1000),
        ),
        Claim("the run is fine", not ours.trouble, "; ".join(ours.trouble) or "yes"),
    ]


if __name__ == "__main__":
    sys.exit(main())
