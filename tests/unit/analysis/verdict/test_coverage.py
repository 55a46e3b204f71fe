"""How often the bounds of the idle error and of its spread hold, by simulation.

The number of cosines was chosen on first-order autoregressive readings at 1 Hz (`TUNED`). What is
required is measured on others: an Ornstein-Uhlenbeck process, exact between its readings, in whole
degrees, with other seeds and rates, up to a correlation time of a fifteenth of the rest (`SHARES`);
further courses and slower drifts are reported (`OTHERS`).
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

LENGTHS_S = (300, 600, 900, 1800, 3600)
SHARES = (1 / 15, 1 / 30, 1 / 100)
"""Correlation times, as shares of the rest."""
LEAST_MEAN = 0.88
LEAST_SD = 0.84
"""Shares of bounds that hold at least, whatever the correlation time in `SHARES`."""
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


@pytest.mark.parametrize("seconds", [300, 900])
@pytest.mark.parametrize("share", SHARES)
def test_bounds_hold_as_often_as_they_say(share: float, seconds: float) -> None:
    times = 300
    found = tried(slow(share * seconds), seconds, 2.0, times, 11)
    assert found.given == times
    assert found.mean / times >= LEAST_MEAN - slack(LEAST_MEAN, times)
    assert found.sd / times >= LEAST_SD - slack(LEAST_SD, times)


def test_batch_means_would_not_have_held() -> None:
    """The test can tell: by batch means a fifth of these bounds does not hold."""
    held = 0
    for one in range(60):
        rng = np.random.default_rng([12, one])
        idle = idle_of(told(rng, slow(40.0)(rng, 600, 2.0), MEAN_C, 2.0), 2.0)
        earlier = by_batch_means(idle.cells.in_order())
        held += earlier[0] <= MEAN_C <= earlier[1]
    assert held < 51


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

OTHERS: dict[str, tuple[Course, tuple[float, float]]] = {
    "τ 3 s + noise": (noisy(3.0), (0, 0)),
    "τ 20 s + noise": (noisy(20.0), (0, 0)),
    "ringing 2 s, τ 6 s": (ringing(2.0, 6.0), (0, 0)),
    "ringing 8 s, τ 10 s": (ringing(8.0, 10.0), (0, 0)),
    "τ 3 s, pieces of 6 s": (in_pieces(slow(3.0), 6.0, 14.0), (6.0, 14.0)),
    "τ 20 s, pieces of 6 s": (in_pieces(slow(20.0), 6.0, 14.0), (6.0, 14.0)),
}
DRIFTS_S = (60.0, 120.0, 300.0, 900.0)


def is_missed(found: Tried, times: int, counted: Counted) -> bool:
    """Count it; whether fewer bounds hold than have to."""
    counted(courses=found.courses, bounds_given=found.given, mean_outside=found.given - found.mean)
    return (
        found.mean < (LEAST_MEAN - slack(LEAST_MEAN, times)) * found.given
        or found.sd < (LEAST_SD - slack(LEAST_SD, times)) * found.given
    )


@pytest.mark.campaign
@pytest.mark.parametrize("share", SHARES)
def test_bounds_hold_at_every_length_and_rate(
    share: float, counted: Counted, capsys: pytest.CaptureFixture[str]
) -> None:
    times, lines, missed = 400, [], []
    for seconds in LENGTHS_S:
        row = []
        for hz in (10.0, 1.0):
            found = tried(slow(share * seconds), seconds, hz, times, 31)
            row.append(f"{hz:g} Hz {found}")
            if is_missed(found, times, counted) or found.given < times:
                missed.append((seconds, hz, str(found)))
        tau_s = share * seconds
        lines.append(f"τ {tau_s:.3g} s, {seconds:4d} s: mean sd not-known: " + " | ".join(row))
    with capsys.disabled():
        print("", *lines, sep="\n")
    assert missed == []


@pytest.mark.campaign
@pytest.mark.parametrize("name", OTHERS)
def test_bounds_hold_for_other_courses(
    name: str, counted: Counted, capsys: pytest.CaptureFixture[str]
) -> None:
    course, pieces = OTHERS[name]
    times, lines, missed = 150, [], []
    for seconds in LENGTHS_S:
        found = tried(course, seconds, 2.0, times, 32, pieces)
        lines.append(f"{name}, {seconds:4d} s: mean sd not-known: {found}")
        if is_missed(found, times, counted):
            missed.append((seconds, str(found)))
    with capsys.disabled():
        print("", *lines, sep="\n")
    assert missed == []


@pytest.mark.campaign
def test_how_often_bounds_hold_with_slower_drifts(
    counted: Counted, capsys: pytest.CaptureFixture[str]
) -> None:
    """Reported only: nothing is promised of them."""
    times, lines = 200, []
    for tau_s in DRIFTS_S:
        row = []
        for seconds in LENGTHS_S:
            found = tried(slow(tau_s), seconds, 1.0, times, 33)
            is_missed(found, times, counted)
            row.append(f"{seconds} s {found}")
        lines.append(f"τ {tau_s:g} s: mean sd not-known: " + " | ".join(row))
    with capsys.disabled():
        print("", *lines, sep="\n")


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
