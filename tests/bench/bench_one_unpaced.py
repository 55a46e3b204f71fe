"""What a request costs when nothing waits: one station, asked without pause on a link that takes no
time.

``jbclog run --rate max`` runs with everything included (decoding, checks, rows, a commit each
second). PyMeasure does the same four reads on the same virtual station and writes them with its own
CSV writer. The bare pyserial loop, which stores nothing, is there for information.
"""

from __future__ import annotations

import sys
from statistics import median

import bare
import others
from bare import Measured
from common import Bench, Claim, at_most, in_own_process, is_short, judge, show, virtual_stations
from recorder import Recorded, record

COLUMNS = ("", "exchanges", "a second", "CPU µs")
CONTENDERS = ("bare pyserial loop, keeps nothing", "PyMeasure with its CSV writer", "jbclog")


def main() -> int:
    rounds, seconds = (1, 5.0) if is_short(__doc__) else (5, 10.0)
    with virtual_stations(1, wire=False) as station:
        made = [_round(station, seconds, number) for number in range(rounds)]
    rows = [
        [name, *(median(figures) for figures in zip(*map(_figures, each), strict=True))]
        for name, each in zip(CONTENDERS, zip(*made, strict=True), strict=True)
    ]
    show(f"one station, unpaced, medians of {rounds} rounds of {seconds:g} s", COLUMNS, rows)
    ratios = [ours.cpu_us / pymeasure.cpu_us for _, pymeasure, ours in made]
    print("  CPU of jbclog, of PyMeasure's in the same round:", *(f"{one:.2f}" for one in ratios))
    trouble = [text for *_, ours in made for text in ours.trouble]
    return judge(
        [
            # 0.7 until each answer waited for a second one that contradicts it (F-50)
            at_most("CPU per exchange, of PyMeasure's, median", median(ratios), 0.9),
            Claim("the runs are fine", not trouble, "; ".join(trouble) or "yes"),
        ]
    )


def _round(station: Bench, seconds: float, number: int) -> tuple[Measured, Measured, Recorded]:
    """Measure each contender once."""
    port, folder = station.ports[0], station.folder / f"{number}"
    folder.mkdir()
    return (
        in_own_process(bare.loop, port, seconds),
        in_own_process(others.pymeasure, port, seconds, folder / "pymeasure.csv"),
        in_own_process(
            record,
            station.line,
            station.recipe(alarms_every_s=0.1),
            folder,
            seconds,
            rate="max",
        ),
    )


def _figures(one: Measured | Recorded) -> tuple[float, float, float]:
    return one.exchanges, one.exchanges / one.seconds, one.cpu_us


if __name__ == "__main__":
    sys.exit(main())
