"""How busy the link is: one addressed port with no response time, asked without pause.

A link at 19200 8N1 carries 71.1 addressed reads a second. The virtual station logs when each
request came and when its answer ended. From this log comes the share of time with bytes on the
link, for the bare pyserial loop and for ``jbclog run --rate max`` alike.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import bare
from common import (
    READ_S,
    Bench,
    Claim,
    at_most,
    bytes_allow,
    in_own_process,
    is_short,
    judge,
    show,
    virtual_stations,
)
from recorder import record
from wire_log import Use, slack_s, use_of

CONTENDERS = ("bare pyserial loop", "jbclog --rate max")
COLUMNS = (
    *("", "exchanges", "a second", "% of the wire", "idle µs an exchange: 10 %", "50 %"),
    "CPU µs",
)


@dataclass(frozen=True, slots=True)
class Side:
    """What one contender did in one round."""

    use: Use
    cpu_us: float
    trouble: Sequence[str] = ()


def main() -> int:
    rounds, seconds = (1, 6.0) if is_short(__doc__) else (5, 20.0)
    with virtual_stations(1, log=True) as station:
        made = [_round(station, seconds, number) for number in range(rounds)]
    contenders = zip(CONTENDERS, zip(*made, strict=True), strict=True)
    show(
        f"one port, no turnaround, no pause, medians of {rounds} rounds of {seconds:g} s",
        COLUMNS,
        [_row(name, sides) for name, sides in contenders],
    )
    return judge(_claims(made))


def _round(station: Bench, seconds: float, number: int) -> tuple[Side, Side]:
    """Measure each contender once."""
    folder = station.folder / f"{number}"
    folder.mkdir()
    loop = in_own_process(bare.loop, station.ports[0], seconds)
    ours = in_own_process(record, station.line, station.recipe(), folder, seconds, rate="max")
    return (
        Side(use_of(station.wire_log, loop.began, loop.seconds), loop.cpu_us),
        Side(use_of(station.wire_log, ours.began, ours.seconds), ours.cpu_us, ours.trouble),
    )


def _row(name: str, sides: Sequence[Side]) -> list[object]:
    """The medians of a contender's rounds."""
    return [name, *map(median, zip(*map(_figures, sides), strict=True))]


def _figures(side: Side) -> tuple[float, ...]:
    use = side.use
    return use.exchanges, use.a_second, use.percent, *use.idle_us, side.cpu_us


def _claims(made: Sequence[tuple[Side, Side]]) -> list[Claim]:
    less = [loop.use.percent - ours.use.percent for loop, ours in made]
    longer = [(ours.use.idle_us[1] - loop.use.idle_us[1]) / (READ_S * 1e4) for loop, ours in made]
    print("  points less of the wire in use than the bare loop:", *(f"{one:.2f}" for one in less))
    trouble = [text for _, ours in made for text in ours.trouble]
    return [
        at_most("points less of the wire in use, median", median(less), 0.5),
        at_most(
            "idle in an exchange beyond the bare loop's, of what the bytes take, median",
            median(longer),
            0.5,
            " %",
        ),
        *(
            bytes_allow(who, *_shortest(side.use))
            for sides in made
            for who, side in zip(CONTENDERS, sides, strict=True)
        ),
        Claim("the runs are fine", not trouble, "; ".join(trouble) or "yes"),
    ]


def _shortest(use: Use) -> tuple[float, float]:
    """The exchange with the least slack: its time, and the time of its bytes."""
    took = use.shortest.answered - use.shortest.asked
    return took, took - slack_s(use.shortest)


if __name__ == "__main__":
    sys.exit(main())
