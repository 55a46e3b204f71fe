"""How busy the link is: one addressed port with no response time, asked without pause.

A link at 19200 8N1 carries 71.1 addressed reads a second. The virtual station logs when each
request came and when its answer ended. From this log comes the share of time with bytes on the
link, for the bare pyserial loop and for ``jbclog run --rate max`` alike.
"""

from __future__ import annotations

import sys

import bare
from common import (
    READ_S,
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
from wire_log import Use, slack_s, use_of

COLUMNS = (
    *("", "exchanges", "a second", "% of the wire", "idle µs an exchange: 10 %", "50 %"),
    "CPU µs",
)


def main() -> int:
    seconds = 6.0 if is_short(__doc__) else 30.0
    with virtual_stations(1, log=True) as station:
        loop = in_own_process(bare.loop, station.ports[0], seconds)
        ours = in_own_process(
            record, station.line, station.recipe(), station.folder, seconds, rate="max"
        )
        bare_use = use_of(station.wire_log, loop.began, loop.seconds)
        our_use = use_of(station.wire_log, ours.began, ours.seconds)
    rows = [
        _row("bare pyserial loop", bare_use, loop.cpu_us),
        _row("jbclog --rate max", our_use, ours.cpu_us),
    ]
    show(f"one port, no turnaround, no pause, {seconds:g} s", COLUMNS, rows)
    return judge(_claims(bare_use, our_use, ours))


def _row(name: str, use: Use, cpu_us: float) -> list[object]:
    return [name, use.exchanges, use.a_second, use.percent, *use.idle_us, cpu_us]


def _claims(bare_use: Use, our_use: Use, ours: Recorded) -> list[Claim]:
    return [
        at_least(
            f"of the wire in use, where the bare loop has {bare_use.percent:.1f} %",
            our_use.percent,
            _wanted(bare_use),
            " %",
        ),
        at_most(
            "idle in an exchange beyond the bare loop's, medians, of what the bytes take",
            (our_use.idle_us[1] - bare_use.idle_us[1]) / (READ_S * 1e4),
            0.5,
            " %",
        ),
        *(
            bytes_allow(who, *_shortest(use))
            for who, use in (("bare loop", bare_use), ("jbclog", our_use))
        ),
        Claim("the run is fine", not ours.trouble, "; ".join(ours.trouble) or "yes"),
    ]


def _wanted(bare_use: Use) -> float:
    """97 % is 0.99 of the 98 % that the bare loop reaches; on a busy machine, the same share of
    what it does reach.
    """
    return min(97.0, 0.99 * bare_use.percent)


def _shortest(use: Use) -> tuple[float, float]:
    """The exchange with the least slack: its time, and the time of its bytes."""
    took = use.shortest.answered - use.shortest.asked
    return took, took - slack_s(use.shortest)


if __name__ == "__main__":
    sys.exit(main())
