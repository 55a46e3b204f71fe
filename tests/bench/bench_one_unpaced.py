"""What a request costs when nothing waits: one station, asked without pause on a link that takes no
time.

``jbclog run --rate max`` runs with everything included (decoding, checks, rows, a commit each
second). PyMeasure does the same four reads on the same virtual station and writes them with its own
CSV writer. The bare pyserial loop, which stores nothing, is there for information.
"""

from __future__ import annotations

import sys

import bare
import others
from common import Claim, at_most, in_own_process, is_short, judge, show, virtual_stations
from recorder import record

COLUMNS = ("", "exchanges", "a second", "CPU µs")


def main() -> int:
    seconds = 5.0 if is_short(__doc__) else 15.0
    with virtual_stations(1, wire=False) as station:
        loop = in_own_process(bare.loop, station.ports[0], seconds)
        pymeasure = in_own_process(
            others.pymeasure, station.ports[0], seconds, station.folder / "pymeasure.csv"
        )
        ours = in_own_process(
            record,
            station.line,
            station.recipe(alarms_every_s=0.1),
            station.folder,
            seconds,
            rate="max",
        )
    contenders = (
        ("bare pyserial loop, keeps nothing", loop),
        ("PyMeasure with its CSV writer", pymeasure),
        ("jbclog", ours),
    )
    rows = [
        [name, one.exchanges, one.exchanges / one.seconds, one.cpu_us] for name, one in contenders
    ]
    show(f"one station, unpaced, no pause, {seconds:g} s", COLUMNS, rows)
    return judge(
        [
            at_most("CPU per exchange, of PyMeasure's", ours.cpu_us / pymeasure.cpu_us, 1.0),
            Claim("the run is fine", not ours.trouble, "; ".join(ours.trouble) or "yes"),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
