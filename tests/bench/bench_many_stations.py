"""64 and 250 stations x 10 Hz x 4 reads in one process: whether each tick is on time, and what a
request costs.

The ticks of all stations coincide, the links are paced at 19200 8N1, the virtual stations share the
processors, and the record is sealed once in the middle. The baseline is one bare pyserial thread
per station on the same schedule, which does not decode, check or store anything.
"""

from __future__ import annotations

import sys
from statistics import median

import bare
from common import (
    HZ,
    READ_S,
    Bench,
    Claim,
    at_least,
    at_most,
    bytes_allow,
    in_own_process,
    is_short,
    judge,
    show,
    virtual_stations,
)
from recorder import Recorded, record

ALARMS_EVERY_S = 0.2  # fills the three fast reads of a tick up to four
COLUMNS = ("", "exchanges", "a tick", "CPU µs", "late ms 50 %", "99 %", "latest", "skipped")


def main() -> int:
    short = is_short(__doc__)
    claims = sixty_four(*((1, 10.0) if short else (3, 60.0))) + many(8.0 if short else 30.0)
    return judge(claims)


def sixty_four(rounds: int, seconds: float) -> list[Claim]:
    """Both in turns; the CPU's claim is about the median round, the others about each."""
    claims: list[Claim] = []
    ratios: list[float] = []
    with virtual_stations(64) as stations:
        for number in range(rounds):
            ours = _record(stations, seconds, f"{number}")
            threads = in_own_process(bare.threads, stations.ports, seconds)
            show(
                f"64 stations, {seconds:g} s, one seal in the middle",
                COLUMNS,
                [_bare_row(threads, 64), _row(ours)],
            )
            print(
                "  jbclog from opening the ports to the sealed and judged record:"
                f" {ours.cpu_all_us:.1f} µs an exchange"
            )
            claims += [*_kept(ours, 3.0), bytes_allow("bare threads", threads.shortest_s)]
            ratios.append(ours.cpu_us / threads.cpu_us)
    print("  CPU per exchange, of a bare thread's:", *(f"{one:.2f}" for one in ratios))
    what = "64 stations: CPU per exchange, of a bare pyserial thread's each, median"
    return [*claims, at_most(what, median(ratios), 0.5)]


def many(seconds: float) -> list[Claim]:
    with virtual_stations(250) as stations:
        ours = _record(stations, seconds, "many")
    show(f"250 stations, {seconds:g} s", COLUMNS, [_row(ours)])
    return _kept(ours, 5.0)


def _record(stations: Bench, seconds: float, name: str) -> Recorded:
    recipe, folder = stations.recipe(alarms_every_s=ALARMS_EVERY_S), stations.folder / name
    folder.mkdir()
    return in_own_process(
        record, stations.line, recipe, folder, seconds, seal_every_s=seconds / 2 + 2
    )


def _kept(ours: Recorded, late_ms: float) -> list[Claim]:
    who = f"{ours.stations} stations"
    return [
        Claim(
            f"{who}: no tick skipped",
            ours.ticks_skipped == 0,
            f"{ours.ticks_skipped} of {ours.rows}",
        ),
        Claim(
            f"{who}: 99 % of ticks less than {late_ms:g} ms late",
            ours.late_ms[1] < late_ms,
            f"{ours.late_ms[1]:.2f} ms",
        ),
        at_least(
            f"{who}: reads a tick", _reads_a_tick(ours.exchanges, ours.stations, ours.seconds), 4.0
        ),
        bytes_allow(f"{who}: three reads of a row", ours.shortest_scan_s, 3 * READ_S),
        Claim(f"{who}: the run is fine", not ours.trouble, "; ".join(ours.trouble) or "yes"),
    ]


def _reads_a_tick(exchanges: int, stations: int, seconds: float) -> float:
    return exchanges / stations / seconds / HZ


def _row(ours: Recorded) -> list[object]:
    reads = _reads_a_tick(ours.exchanges, ours.stations, ours.seconds)
    return ["jbclog", ours.exchanges, reads, ours.cpu_us, *ours.late_ms, ours.ticks_skipped]


def _bare_row(threads: bare.Measured, stations: int) -> list[object]:
    reads = _reads_a_tick(threads.exchanges, stations, threads.seconds)
    return [
        "bare pyserial threads",
        threads.exchanges,
        reads,
        threads.cpu_us,
        *threads.late_ms,
        threads.ticks_skipped,
    ]


if __name__ == "__main__":
    sys.exit(main())
