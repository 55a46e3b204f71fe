"""What `--capture` costs: CPU per exchange, late ticks, disk space.

The same stations are recorded without and with it: four reads a tick at 10 Hz, on links paced at
19200 8N1. An exchange is three rows of the capture: the request, the answer, and what the session
received.
"""

from __future__ import annotations

import sys

from common import (
    HZ,
    Bench,
    Claim,
    at_least,
    at_most,
    in_own_process,
    is_short,
    judge,
    show,
    virtual_stations,
)
from recorder import Recorded, record

ALARMS_EVERY_S = 0.2  # fills the three fast reads of a tick up to four
FULL_WIRE = 71  # exchanges a second that 19200 8N1 carries
COLUMNS = (
    "",
    "exchanges",
    "CPU µs",
    "late ms 50 %",
    "99 %",
    "latest",
    "bytes each",
    "MB/h full wire",
)
STATIONS = 16


def main() -> int:
    seconds = 10.0 if is_short(__doc__) else 60.0
    with virtual_stations(STATIONS) as stations:
        bare = _record(stations, seconds, wire=False)
        kept = _record(stations, seconds, wire=True)
    show(
        f"{STATIONS} stations, {seconds:g} s",
        COLUMNS,
        [_row("without", bare), _row("--capture", kept)],
    )
    return judge(_claims(bare, kept))


def _record(stations: Bench, seconds: float, *, wire: bool) -> Recorded:
    recipe = stations.recipe(alarms_every_s=ALARMS_EVERY_S)
    return in_own_process(record, stations.line, recipe, stations.folder, seconds, wire=wire)


def _claims(bare: Recorded, kept: Recorded) -> list[Claim]:
    return [
        at_most("CPU per exchange, of one without", kept.cpu_us / bare.cpu_us, 1.6),
        at_most(
            "99 % of ticks later than without by", kept.late_ms[1] - bare.late_ms[1], 2.0, " ms"
        ),
        at_most("bytes for each exchange", kept.wire_bytes / kept.wire_exchanges, 40.0),
        Claim("no tick skipped", kept.ticks_skipped == 0, f"{kept.ticks_skipped} of {kept.rows}"),
        at_least("reads a tick", kept.exchanges / kept.seconds / STATIONS / HZ, 3.95),
        Claim(
            "the runs are fine",
            not bare.trouble + kept.trouble,
            "; ".join(bare.trouble + kept.trouble) or "yes",
        ),
    ]


def _row(name: str, one: Recorded) -> list[object]:
    each = one.wire_bytes / max(one.wire_exchanges, 1)
    return [name, one.exchanges, one.cpu_us, *one.late_ms, each, each * FULL_WIRE * 3600 / 1e6]


if __name__ == "__main__":
    sys.exit(main())
