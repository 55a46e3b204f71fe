"""Reasons to refuse a chart or an index.

Each refusal prevents a mistake whose size was measured: an individuals chart of autocorrelated
values (lag-1 correlation 0.9) shows a third of them out of control, with a sigma three times too
small; a spread below the resolution makes Cpk arbitrarily large. See
docs/explanation/capability.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import exp, log, sqrt
from typing import TYPE_CHECKING, Final

import numpy as np

from jbclog.analysis.spc import special
from jbclog.analysis.spc.charts import Chart
from jbclog.analysis.spc.distribution import LOG_ROOT, Fit, Floats
from jbclog.analysis.spc.nelson import BEYOND_3, TESTS, signals
from jbclog.core.errors import UsageError
from jbclog.core.text import count_text

CLEARLY: Final = 10.0  # difference of BIC: "very strong" (Kass and Raftery 1995)
APART: Final = 2.0
LEAST_SHARE: Final = 0.05  # a smaller share is outliers
MOST_ROUNDS: Final = 200
LEAST_POINTS = 20  # minimum for limits of a chart (Montgomery: 20 to 25)
LEAST_FOR_CAPABILITY = 30  # with which the lower bound of a Cpk of 1.33 is 1.03
MOST_LAG_1 = 0.3
ALIKE = 0.01  # p-value of the correlation
LEAST_STEPS = 5  # distinct values; with fewer, the spread is that of the resolution
BY_CHANCE = 0.01  # probability of as many signals in a stable process
SHIFT_BY_CHANCE = 0.005  # p-value of a step or a drift
LEAST_FOR_PERCENTILES = 741  # values of which one beyond 0.135 % is expected


@dataclass(frozen=True, slots=True)
class Refused:
    """Why there is no result: `kind` for programs, `text` for people.

    Whoever unpacks it, or uses it as the result, gets a `UsageError` with this text.
    """

    kind: str
    text: str

    if not TYPE_CHECKING:  # for a type checker it has nothing of a result

        def __iter__(self):
            raise UsageError(self.text)

        def __getitem__(self, place):
            raise UsageError(self.text)

        def __getattr__(self, name):
            if name.startswith("_") or name in Refused.__slots__:
                raise AttributeError(name)
            raise NoResult(self.text)


class NoResult(UsageError, AttributeError):
    """A refusal was used as a result; also an `AttributeError`, so that `hasattr` works."""


Check = Callable[[], Refused | None]


def first_refusal(checks: Iterable[Check]) -> Refused | None:
    """Return the first refusal of these checks, or None; order them by usefulness."""
    return next((refused for check in checks if (refused := check()) is not None), None)


def too_few(count: int, least: int, what: str) -> Refused | None:
    """Refuse too few values: their limits describe the values more than the process."""
    if count >= least:
        return None
    return Refused("too_few", f"{there_are(count, what)}; it takes at least {least}.")


def there_are(count: int, what: str) -> str:
    """Return a count as ``There are 3 days with alarms`` or ``There is 1 day with alarms``."""
    noun, *rest = what.split(" ", 1)
    one = noun.removesuffix("es" if noun.endswith("ches") else "s")
    return (
        f"There {'is' if count == 1 else 'are'} {count}"
        f" {' '.join([one if count == 1 else noun, *rest])}"
    )


def lag_1(points: Floats) -> float:
    """Return the lag-1 autocorrelation."""
    away = points - points.mean()
    total = float(away @ away)
    return float(away[:-1] @ away[1:]) / total if total else 0.0


def autocorrelated(points: Floats) -> Refused | None:
    """Refuse autocorrelated values: their limits would be far too narrow."""
    found, chance = lag_1(points), float(-special.ndtri(ALIKE)) / sqrt(len(points))
    if found <= max(MOST_LAG_1, chance):
        return None
    text = (
        f"Neighbouring values are alike (lag-1 correlation {found:.2f}, at most"
        f" {max(MOST_LAG_1, chance):.2f} allowed), "
    )
    return Refused(
        "autocorrelated", text + "so limits from their differences would be far too narrow."
    )


def unresolved(points: Floats, sigma: float, resolution: float | None) -> Refused | None:
    """Refuse a spread that is due to the resolution or hidden by it."""
    if not resolution:
        if sigma > 0:
            return None
        return Refused("unresolved", "All values are the same; their spread is not known.")
    steps = len(np.unique(np.round(points / resolution)))
    if sigma >= resolution / sqrt(12) and steps >= LEAST_STEPS:
        return None
    text = (
        f"The values come in steps of {resolution:g} and take {steps} of them (standard deviation"
        f" {sigma:.2g}); "
    )
    return Refused(
        "unresolved", text + "their spread is that of the resolution, not of the process."
    )


def unstable(chart: Chart, distances: Floats) -> Refused | None:
    """Refuse a point further out, or more signals, than a stable process gives by chance; a long
    series has some.

    `distances` is how far each point is from the centre for certain; 0 if a rounded value may be on
    either side.
    """
    n, zones = len(distances), distances / chart.sigma
    furthest = float(np.abs(zones).max())
    if special.ndtr(-furthest) * 2 * n < BY_CHANCE:
        return _not_stable(f"a point of {n} is {furthest:.1f} sigma from the centre")
    sides = zones[zones != 0]
    return _too_often(1, zones, BEYOND_3) or _too_often(2, sides, rate_of_nine(sides))


def _too_often(number: int, zones: Floats, rate: float) -> Refused | None:
    """Refuse more signals of one of Nelson's tests than its rate explains."""
    seen = _count_runs([one.last for one in signals(zones, (number,))])
    if not seen or special.pdtrc(seen - 1, rate * len(zones)) >= BY_CHANCE:
        return None
    return _not_stable(
        f"{TESTS[number - 1].text}, {count_text(seen, 'time')} in {len(zones)} points"
    )


def _not_stable(what: str) -> Refused:
    text = f"The process is not stable: {what}; an index would describe no process that exists."
    return Refused("unstable", text)


def rate_of_nine(sides: Floats) -> float:
    """Return how often a run of nine on one side begins at a point, for values that lie above as
    often as these do.

    Values on neither side are left out, as in any test of runs (Gibbons and Chakraborti,
    Nonparametric Statistical Inference, chapter 3). The sides need not be equal, because steps of a
    resolution seldom lie evenly about the centre.
    """
    above = float(np.mean(sides > 0)) if len(sides) else 0.5
    below = 1 - above
    return above**9 * below + below**9 * above


def _count_runs(places: list[int]) -> int:
    """Return how often a pattern began; one that continues from point to point counts once."""
    return sum(
        before is None or place > before + 1
        for before, place in zip([None, *places], places, strict=False)
    )


def shifted(points: Floats) -> Refused | None:
    """Refuse a step (Pettitt 1979) or a drift (Spearman), by ranks and so for any distribution."""
    n, ranks = len(points), ranked(points)
    sums = np.cumsum(2 * ranks - (n + 1))[:-1]
    place = int(np.abs(sums).argmax())
    step = min(1.0, 2 * exp(-6 * float(sums[place]) ** 2 / (n**3 + n**2)))
    order = np.arange(n) - (n - 1) / 2
    away = ranks - ranks.mean()
    rho = float(order @ away) / sqrt(float(order @ order) * float(away @ away) or 1.0)
    drift = 2 * float(special.stdtr(n - 2, -abs(rho) * sqrt((n - 2) / max(1 - rho**2, 1e-12))))
    if min(step, drift) >= SHIFT_BY_CHANCE:
        return None
    what = f"it drifts (rank correlation with the order {rho:+.2f}, p = {drift:.2g})"
    if step <= drift:
        before, after = float(np.median(points[: place + 1])), float(np.median(points[place + 1 :]))
        what = (
            f"it steps after value {place + 1} of {n} (median {before:.4g} before, {after:.4g}"
            f" after; Pettitt, p = {step:.2g})"
        )
    return _not_stable(what)


def mixed(points: Floats, fit: Fit, resolution: float | None) -> Refused | None:
    """Refuse two processes in one series."""
    two = two_populations(points, fit, resolution)
    if two is None:
        return None
    text = (
        f"The values are of two populations, about {two.means[0]:.4g} ({two.share:.0%}) and about"
        f" {two.means[1]:.4g}; "
    )
    return Refused("two_populations", text + "chart each by itself.")


def ranked(points: Floats) -> Floats:
    """Return the rank of each value from 1; equal values share the mean of their ranks."""
    _, places, counts = np.unique(points, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(counts) - (counts - 1) / 2)[places], dtype=np.float64)


def rank_scores(points: Floats) -> Floats:
    """Return normal scores by rank, for values that no distribution fits."""
    return np.asarray(special.ndtri((ranked(points) - 0.5) / len(points)))


def no_distribution(points: Floats) -> Refused | None:
    """Refuse few values that no family fits: their own percentiles need many."""
    n = len(points)
    if n >= LEAST_FOR_PERCENTILES:
        return None
    text = (
        f"No distribution fits the {n} values (Anderson-Darling, p below 0.05 for normal,"
        " lognormal, Weibull and Box-Cox); "
    )
    return Refused(
        "not_normal",
        f"{text}their own percentiles 0.135 and 99.865 take at least {LEAST_FOR_PERCENTILES}"
        " values.",
    )


@dataclass(frozen=True, slots=True)
class TwoPopulations:
    """Means and standard deviations of both, and the first one's share of all values."""

    means: tuple[float, float]
    sds: tuple[float, float]
    share: float


def two_populations(
    values: Floats, one: Fit, resolution: float | None = None
) -> TwoPopulations | None:
    """Return two populations (two tips, two recipes, joints and touches) if they explain the values
    clearly better than one; else None.

    A mixture of two normal distributions must be clearly more likely than the best single
    distribution and than an even spread (BIC, by `CLEARLY`), and the two must lie clearly apart: D
    of Ashman, Bird and Zepf (Astronomical Journal 108, 1994) above 2, which a mixture needs to have
    two peaks.
    """
    n, ordered = len(values), np.sort(values)
    floor = max(0.1 * float(values.std()), (resolution or 0.0) / sqrt(12))
    found, likelihood = _mixture(ordered, floor)
    apart = abs(found.means[1] - found.means[0]) / sqrt((found.sds[0] ** 2 + found.sds[1] ** 2) / 2)
    if apart <= APART or not LEAST_SHARE <= found.share <= 1 - LEAST_SHARE:
        return None
    mixed = 5 * log(n) - 2 * likelihood
    even = 2 * log(n) + 2 * n * log(float(np.ptp(values)))
    return found if mixed + CLEARLY < min(even, one.bic(values)) else None


def _mixture(ordered: Floats, floor: float) -> tuple[TwoPopulations, float]:
    """Return the most likely mixture of two and its log-likelihood; starts from the gap that
    separates the values best.
    """
    n = len(ordered)
    counts = np.arange(1, n)
    sums = np.cumsum(ordered)[:-1]
    between = (sums / counts - (ordered.sum() - sums) / (n - counts)) ** 2 * counts * (n - counts)
    cut = int(np.argmax(between)) + 1
    weight = np.zeros((2, n))
    weight[0, :cut] = weight[1, cut:] = 1.0
    last = -np.inf
    for _ in range(MOST_ROUNDS):
        share = np.maximum(weight.sum(axis=1), 1e-9)
        means = (weight @ ordered) / share
        sds = np.maximum(
            np.sqrt((weight * (ordered - means[:, np.newaxis]) ** 2).sum(axis=1) / share), floor
        )
        away = (ordered - means[:, np.newaxis]) / sds[:, np.newaxis]
        parts = (
            np.log(share / n)[:, np.newaxis] - np.log(sds)[:, np.newaxis] + LOG_ROOT - away**2 / 2
        )
        total = np.logaddexp(parts[0], parts[1])
        weight = np.exp(parts - total)
        likelihood = float(total.sum())
        if likelihood - last < 1e-6 * n:
            break
        last = likelihood
    two = TwoPopulations(
        (float(means[0]), float(means[1])), (float(sds[0]), float(sds[1])), float(share[0] / n)
    )
    return two, likelihood
