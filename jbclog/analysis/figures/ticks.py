"""Ticks of an axis: round values and round UTC times; durations as text."""

from __future__ import annotations

from math import ceil
from typing import Final

from matplotlib.ticker import MaxNLocator

from jbclog.core.clock import utc_of

STEPS: Final = (1, 2, 5, 10)  # round steps, in units of a power of ten


def round_values(low: float, high: float, most: int, *, whole: bool = True) -> list[float]:
    """Return round values from `low` to `high` in at most `most` steps; integers if `whole`."""
    locator = MaxNLocator(most, steps=STEPS, integer=whole, min_n_ticks=1)
    return [float(value) for value in locator.tick_values(low, high) if low <= value <= high]


def spread(places: list[float], least: float, bottom: float, top: float) -> list[float]:
    """Return `places` (ascending), moved as little as needed to lie `least` apart, between `bottom`
    and `top` if they fit.
    """
    out: list[float] = []
    for place in places:
        out.append(max(place, out[-1] + least) if out else max(place, bottom))
    if out and out[-1] > top:
        out[-1] = top
        for i in range(len(out) - 2, -1, -1):
            out[i] = min(out[i], out[i + 1] - least)
    return out


MINUTE, HOUR, DAY = 60, 3600, 86400
STEPS_S = (
    *(1, 2, 5, 10, 15, 30),
    *(MINUTE * n for n in (1, 2, 5, 10, 15, 30)),
    *(HOUR * n for n in (1, 2, 3, 6, 12)),
    *(DAY * n for n in (1, 2, 7, 14, 30, 90)),
)


def time_marks(
    t0_utc_us: int, start_s: float, end_s: float, at_most: int
) -> list[tuple[float, str]]:
    """Return places (s of the run) and labels of round UTC times from `start_s` to `end_s`."""
    step = next((step for step in STEPS_S if (end_s - start_s) / step <= at_most - 1), STEPS_S[-1])
    zero_s = t0_utc_us / 1e6
    first = ceil((zero_s + start_s) / step - 1e-9)
    count = int((zero_s + end_s) / step + 1e-9) - first + 1
    return [
        ((first + i) * step - zero_s, _label((first + i) * step, step))
        for i in range(max(count, 0))
    ]


def _label(utc_s: int, step: int) -> str:
    at = utc_of(utc_s * 1_000_000)
    if step >= DAY or (step >= HOUR and at.hour == at.minute == 0):
        return at.strftime("%m-%d")
    return at.strftime("%H:%M" if step >= MINUTE else "%H:%M:%S")


def duration_text(seconds: float) -> str:
    """Return a duration as text: ``7 h 59 min 38 s``, ``2 min 5 s``, ``20.0 s``."""
    if round(seconds, 1) < 60:
        return f"{seconds:.1f} s"
    hours, rest = divmod(round(seconds), 3600)
    minutes, left = divmod(rest, 60)
    parts = [(hours, "h"), (minutes, "min"), (left, "s")]
    return " ".join(f"{number} {unit}" for number, unit in parts if number)
