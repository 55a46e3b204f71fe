"""Courses of an idle tip whose true mean and standard deviation are known, as a station tells them:
in whole degrees.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.verdict.bounds import Bounds
from jbclog.analysis.verdict.idle import IdleError
from support.plants.filters import filtered

Floats = NDArray[np.float64]
Course = Callable[[np.random.Generator, float, float], Floats]
"""Readings of a course of that length in s at that rate in Hz, mean 0 and standard deviation 1."""


def slow(tau_s: float) -> Course:
    """First-order autoregressive: an Ornstein-Uhlenbeck process as it is sampled."""

    def course(rng: np.random.Generator, seconds: float, hz: float) -> Floats:
        alike = float(np.exp(-1 / (hz * tau_s)))
        steps = rng.standard_normal(round(seconds * hz)) * np.sqrt(1 - alike**2)
        steps[0] = rng.standard_normal()
        return filtered(1, [1, -alike], steps)

    return course


def noisy(tau_s: float, share: float = 0.36) -> Course:
    """The same with white noise of the sensor on top, which makes this share of the variance."""

    def course(rng: np.random.Generator, seconds: float, hz: float) -> Floats:
        below = slow(tau_s)(rng, seconds, hz)
        return np.asarray(
            np.sqrt(1 - share) * below + np.sqrt(share) * rng.standard_normal(len(below)),
            dtype=np.float64,
        )

    return course


def ringing(period_s: float, tau_s: float) -> Course:
    """Second-order autoregressive: a regulator that swings with this period and is damped within
    `tau_s`.
    """

    def course(rng: np.random.Generator, seconds: float, hz: float) -> Floats:
        damped, turn = np.exp(-1 / (hz * tau_s)), 2 * np.pi / (hz * period_s)
        first, second = 2 * damped * np.cos(turn), -(damped**2)
        variance = (1 - second) / ((1 + second) * ((1 - second) ** 2 - first**2))
        rows, lead = round(seconds * hz), round(8 * tau_s * hz)
        steps = rng.standard_normal(rows + lead) / np.sqrt(variance)
        return filtered(1, [1, -first, -second], steps)[lead:]

    return course


def in_pieces(of: Course, piece_s: float, pause_s: float) -> Course:
    """Only what falls between joints: pieces of it, as long as `seconds` together."""

    def course(rng: np.random.Generator, seconds: float, hz: float) -> Floats:
        pieces = int(np.ceil(seconds / piece_s))
        whole = of(rng, pieces * (piece_s + pause_s), hz)
        return whole[_in_piece(len(whole), hz, piece_s, pause_s)][: round(seconds * hz)]

    return course


def moments(rows: int, hz: float, piece_s: float = 0.0, pause_s: float = 0.0) -> Floats:
    """The seconds of so many readings, in pieces where they are."""
    if not piece_s:
        return np.arange(rows) / hz
    every = np.arange(int(rows * (piece_s + pause_s) / piece_s + (piece_s + pause_s) * hz) + 1)
    return every[_in_piece(len(every), hz, piece_s, pause_s)][:rows] / hz


def _in_piece(rows: int, hz: float, piece_s: float, pause_s: float) -> NDArray[np.bool_]:
    return np.asarray(
        np.arange(rows) % round((piece_s + pause_s) * hz) < round(piece_s * hz), dtype=np.bool_
    )


def told(rng: np.random.Generator, course: Floats, mean_c: float, sd_c: float) -> Floats:
    """In whole degrees."""
    return np.asarray(np.round(mean_c + sd_c * course), dtype=np.float64)


def idle_of(errors: Floats, hz: float, at: Floats | None = None) -> IdleError:
    """As the judge adds them up, in blocks."""
    idle, seconds = IdleError(), np.arange(len(errors)) / hz if at is None else at
    for part in np.array_split(np.arange(len(errors)), 3):
        idle.add(seconds[part], errors[part], 1 / hz)
    return idle


def bounds_of(errors: Floats, hz: float, at: Floats | None = None) -> Bounds | str:
    return idle_of(errors, hz, at).bounds()
