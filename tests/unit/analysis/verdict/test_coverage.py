"""How often the bounds of the idle error and of its spread hold, by simulation, and how often they
are given.

The correlation times 0.5, 3 and 20 s and the rates 10, 5 and 1 Hz were tuned on, with other seeds;
all others were not. The figures that have to be reached are for first-order autoregressive courses
in whole degrees; `OTHERS` are tried against what they reach.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from jbclog.analysis import spc
from jbclog.analysis.verdict.bounds import Bounds
from support.plants.idle_courses import (
    Course,
    Floats,
    bounds_of,
    idle_of,
    in_pieces,
    moments,
    noisy,
    ringing,
    slow,
    told,
)

LENGTHS_S = (30, 45, 60, 120, 300, 900)
RATES = (10.0, 5.0, 2.0, 1.0)
TO_HOLD = {0.5: 0.93, 3.0: 0.90, 20.0: 0.88, 0.2: 0.93, 1.5: 0.90, 8.0: 0.88, 12.0: 0.88}
"""Correlation time in s -> the least share of bounds that hold."""
MOST_UNKNOWN = 0.05
MEAN_C, MARGIN_C = 0.3, 2.0
Counted = Callable[..., None]


@dataclass(frozen=True)
class Tried:
    """How many courses, of how many a bound was given, and how many of these held: of the mean, and
    of the standard deviation.
    """

    courses: int = 0
    given: int = 0
    mean: int = 0
    sd: int = 0

    def add(self, found: Bounds | str, mean_c: float, sd_c: float) -> Tried:
        tried = replace(self, courses=self.courses + 1)
        if isinstance(found, str):
            return tried
        assert found.mean.low is not None
        holds = found.mean.low <= mean_c <= found.mean.high
        return replace(
            tried,
            given=self.given + 1,
            mean=self.mean + holds,
            sd=self.sd + (found.sd.high >= sd_c),
        )

    def __str__(self) -> str:
        return (
            f"{self.mean / max(self.given, 1):.3f} {self.sd / max(self.given, 1):.3f}"
            f" {1 - self.given / self.courses:.2f}"
        )


def tried(
    course: Course,
    seconds: float,
    hz: float,
    times: int,
    seed: int,
    pieces: tuple[float, float] = (0, 0),
) -> Tried:
    """So many courses, each from a seed of its own; the spread is another in each."""
    found = Tried()
    for one in range(times):
        rng = np.random.default_rng([seed, one, round(seconds), round(hz)])
        sd_c = float(rng.uniform(0.6, 3.0))
        errors = told(rng, course(rng, seconds, hz), MEAN_C, sd_c)
        at = moments(len(errors), hz, *pieces)
        found = found.add(bounds_of(errors, hz, at), MEAN_C, sd_c)
    return found


def slack(share: float, times: int) -> float:
    """What chance alone takes away, 2.5 standard deviations."""
    return float(2.5 * np.sqrt(share * (1 - share) / times))


@pytest.mark.parametrize(
    ("tau_s", "seconds", "hz"),
    [(0.5, 60, 10.0), (3.0, 30, 2.0), (20.0, 60, 10.0), (20.0, 300, 1.0)],
)
def test_bounds_hold_as_often_as_they_say(tau_s: float, seconds: float, hz: float) -> None:
    times = 120
    found, least = tried(slow(tau_s), seconds, hz, times, 11), TO_HOLD[tau_s]
    assert found.given == times
    assert found.mean / times >= least - slack(least, times)
    assert found.sd / times >= least - slack(least, times)


def test_batch_means_would_not_have_held() -> None:
    """The test can tell: by batch means half of these bounds do not hold."""
    held = 0
    for one in range(60):
        rng = np.random.default_rng([12, one])
        idle = idle_of(told(rng, slow(20.0)(rng, 60, 10.0), MEAN_C, 2.0), 10.0)
        earlier = by_batch_means(idle.cells.in_order())
        held += earlier[0] <= MEAN_C <= earlier[1]
    assert held < 36


def by_batch_means(sums: tuple[Floats, Floats, Floats]) -> tuple[float, float]:
    """The bound that twenty batch means give."""
    parts = zip(np.array_split(sums[1], 20), np.array_split(sums[0], 20), strict=True)
    batches = [part.sum() / count.sum() for part, count in parts]
    half = 2.093 * float(np.std(batches, ddof=1)) / np.sqrt(20)
    return float(np.mean(batches)) - half, float(np.mean(batches)) + half


def verdicts(
    difference_c: float, tau_s: float, times: int, seed: int, hz: float = 10.0, sd_c: float = 1.0
) -> list[str]:
    """Two idle tips this far apart, fifteen minutes of each."""
    said = []
    for one in range(times):
        rng = np.random.default_rng([seed, one, round(10 * tau_s)])
        both = [
            idle_of(told(rng, slow(tau_s)(rng, 900, hz), mean_c, sd_c), hz)
            for mean_c in (MEAN_C, MEAN_C + difference_c)
        ]
        means = []
        for idle in both:
            found = idle.bounds()
            assert isinstance(found, Bounds)
            means.append(spc.Mean(idle.mean_c or 0.0, found.half))
        said.append(spc.equivalence_of(means[0], means[1], MARGIN_C).verdict)
    return said


def test_tips_that_are_a_margin_apart_are_rarely_called_the_same() -> None:
    # 400 pairs in the campaign
    assert verdicts(MARGIN_C, 3.0, 20, 21, hz=1.0).count("equivalent") <= 3
    assert verdicts(0.0, 3.0, 10, 22, hz=1.0).count("equivalent") >= 8


# -- the campaign ----------------------------------------------------------------------------------

OTHERS: dict[str, tuple[Course, tuple[float, float], float]] = {
    "τ 3 s + noise": (noisy(3.0), (0, 0), 0.90),
    "τ 12 s + noise": (noisy(12.0), (0, 0), 0.85),
    "τ 20 s + noise": (noisy(20.0), (0, 0), 0.80),
    # the standard deviation, of 30 s; its mean holds
    "ringing 2 s, τ 6 s": (ringing(2.0, 6.0), (0, 0), 0.80),
    "ringing 8 s, τ 10 s": (ringing(8.0, 10.0), (0, 0), 0.88),
    "τ 3 s, pieces of 6 s": (in_pieces(slow(3.0), 6.0, 4.0), (6.0, 4.0), 0.90),
    "τ 20 s, pieces of 6 s": (in_pieces(slow(20.0), 6.0, 4.0), (6.0, 4.0), 0.88),
}


def is_missed(found: Tried, least: float, times: int, counted: Counted) -> bool:
    """Count it; whether fewer bounds hold than have to."""
    counted(courses=found.courses, bounds_given=found.given, mean_outside=found.given - found.mean)
    return min(found.mean, found.sd) < (least - slack(least, times)) * found.given


@pytest.mark.campaign
@pytest.mark.parametrize("tau_s", sorted(TO_HOLD))
def test_bounds_hold_at_every_length_and_rate(
    tau_s: float, counted: Counted, capsys: pytest.CaptureFixture[str]
) -> None:
    times, lines, missed = 200, [], []
    for seconds in LENGTHS_S:
        row = []
        for hz in RATES:
            found, least = tried(slow(tau_s), seconds, hz, times, 31), TO_HOLD[tau_s]
            row.append(f"{hz:g} Hz {found}")
            if is_missed(found, least, times, counted):
                missed.append((seconds, hz, str(found)))
            if (seconds >= 900 and tau_s <= 3.0 and found.given < (1 - MOST_UNKNOWN) * times) or (
                seconds >= 20 * tau_s and found.given < 0.8 * times
            ):
                missed.append((seconds, hz, "not given"))
        lines.append(f"τ {tau_s:4g} s, {seconds:4d} s: mean sd not-known: " + " | ".join(row))
    with capsys.disabled():
        print("", *lines, sep="\n")
    assert missed == []


@pytest.mark.campaign
@pytest.mark.parametrize("name", OTHERS)
def test_bounds_hold_for_other_courses(
    name: str, counted: Counted, capsys: pytest.CaptureFixture[str]
) -> None:
    course, pieces, least = OTHERS[name]
    times, lines, missed = 150, [], []
    for seconds in LENGTHS_S:
        row = []
        for hz in (10.0, 2.0):
            found = tried(course, seconds, hz, times, 32, pieces)
            row.append(f"{hz:g} Hz {found}")
            if is_missed(found, least, times, counted):
                missed.append((seconds, hz, str(found)))
        lines.append(f"{name}, {seconds:4d} s: mean sd not-known: " + " | ".join(row))
    with capsys.disabled():
        print("", *lines, sep="\n")
    assert missed == []


@pytest.mark.campaign
@pytest.mark.parametrize("tau_s", [0.5, 3.0, 8.0, 20.0])
def test_equivalence_is_found_where_it_holds_and_not_at_the_margin(
    tau_s: float, counted: Counted, capsys: pytest.CaptureFixture[str]
) -> None:
    at_margin, same = verdicts(MARGIN_C, tau_s, 300, 41), verdicts(0.0, tau_s, 100, 42)
    wrong, right = at_margin.count("equivalent"), same.count("equivalent")
    counted(pairs=400, equivalent_at_the_margin=wrong, equivalent_at_0=right)
    with capsys.disabled():
        print(f"\nτ {tau_s:g} s: equivalent at the margin {wrong / 300:.3f}, at 0 {right} %")
    assert wrong <= 18
    assert right >= 80
