"""Thinning for the page: no excursion disappears, nothing is joined across a gap."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.analysis.figures import curves
from jbclog.analysis.figures.curves import (
    GridSeconds,
    envelope,
    lone,
    quantile_of_readings,
    rows_before,
    rows_within,
    runs,
)

EIGHT_HOURS = 288_000


def test_a_single_sample_in_eight_hours_keeps_its_full_height() -> None:
    values = np.full(EIGHT_HOURS, 350.0)
    values[123_456], values[200_001] = 421.0, 17.0
    curve = envelope(np.arange(EIGHT_HOURS) / 10, values, 800, 0.15)
    assert len(curve.seconds) <= 800
    assert np.nanmax(curve.high) == 421
    assert np.nanmin(curve.low) == 17
    hottest = curve.seconds[np.nanargmax(curve.high)]
    assert hottest == pytest.approx(12_345.6, abs=36)


def test_few_samples_are_all_drawn() -> None:
    curve = envelope(np.arange(1600.0), np.arange(1600.0), 800, 1.5)
    assert curve.whole
    assert np.array_equal(curve.mean, np.arange(1600.0))


def test_a_line_is_not_drawn_across_a_gap() -> None:
    seconds = np.array([0.0, 0.1, 0.2, 3.2, 3.3])
    curve = envelope(seconds, np.array([1.0, 2.0, np.nan, 4.0, 5.0]), 800, 0.15)
    assert np.array_equal(curve.mean, [1, 2, np.nan, 4, 5], equal_nan=True)
    thinned = np.arange(40_000) / 10
    values = np.ones(40_000)
    values[10_000:20_000] = np.nan
    curve = envelope(thinned, values, 800, 0.15)
    breaks = np.flatnonzero(np.isnan(curve.mean))
    assert len(breaks) == 1
    assert curve.seconds[breaks[0] - 1] == pytest.approx(1000, abs=5)
    assert curve.seconds[breaks[0] + 1] == pytest.approx(2000, abs=5)


def test_what_stands_alone_is_found() -> None:
    curve = envelope(
        np.array([0.0, 1.0, 2.0, 10.0, 20.0, 21.0]),
        np.array([1.0, 2.0, 3.0, 9.0, 4.0, 5.0]),
        800,
        1.5,
    )
    assert list(lone(curve).mean) == [9]


def test_nothing_at_all() -> None:
    curve = envelope(np.arange(5.0), np.full(5, np.nan), 800, 1.5)
    assert not len(curve.seconds)
    assert not len(lone(curve).seconds)


@given(st.data())
def test_the_band_holds_every_sample(data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    values = np.round(rng.normal(350, 30, 5000))
    values[rng.random(5000) < data.draw(st.floats(0, 0.9))] = np.nan
    seconds = np.cumsum(rng.integers(1, 4, 5000)) / 10
    curve = envelope(seconds, values, 100, 0.15)
    if np.isnan(values).all():
        return
    assert np.nanmax(curve.high) == np.nanmax(values)
    assert np.nanmin(curve.low) == np.nanmin(values)
    assert not (curve.high < curve.mean - 1e-9).any()
    assert not (curve.low > curve.mean + 1e-9).any()
    assert (np.diff(curve.seconds) >= 0).all()


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_curve_is_the_same_in_blocks(
    monkeypatch: pytest.MonkeyPatch, kind: type[np.float32] | type[np.float64]
) -> None:
    chance = np.random.default_rng(3)
    values = chance.integers(300, 400, 5000).astype(kind)
    values[chance.random(5000) < 0.2] = values[1000:1900] = np.nan
    seconds = np.cumsum(chance.integers(1, 3, 5000)) / 10
    whole = envelope(seconds, values, 90, 0.15)
    monkeypatch.setattr(curves, "BLOCK_ROWS", 37)
    pieces = envelope(seconds, values, 90, 0.15)
    assert np.isnan(whole.mean).any()
    for name in ("seconds", "low", "high", "mean"):
        np.testing.assert_array_equal(getattr(pieces, name), getattr(whole, name))
    there = ~np.isnan(values)
    assert np.nanmax(whole.high) == values[there].max()


@pytest.mark.parametrize("kind", ["f2", "f4", "f8"])
@pytest.mark.parametrize("rows", [1, 2, 5, 1000])
def test_a_quantile_of_readings_is_that_of_numpy(
    kind: str, rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(curves, "BLOCK_ROWS", 300)
    celsius = np.round(np.random.default_rng(rows).normal(0, 700, rows)).clip(-2048, 2048)
    parts = [part.astype(kind) for part in np.split(celsius, [rows // 3]) if len(part)]
    before = [part.copy() for part in parts]
    for share in (0.0, 0.02, 0.5, 0.999, 1.0):
        assert quantile_of_readings(parts, share) == np.quantile(celsius, share)
    assert all(map(np.array_equal, parts, before))


@pytest.mark.parametrize("kind", ["i4", "i8"])
def test_seconds_of_a_grid_are_those_of_its_ticks(kind: str) -> None:
    """To the last bit, however they are looked at."""
    ticks = np.append(np.arange(3, 3000), [3500, 2**31 - 1]).astype(kind)
    known, found = ticks.astype(np.float64) * 0.1, GridSeconds(ticks, 0.1)
    some = known % 0.3 < 0.15
    assert len(found) == len(known)
    assert found[-1] == known[-1]
    for rows in (slice(None), slice(5, 9), some, np.array([7, 2])):
        assert np.array_equal(found[rows], known[rows])
    for moment in (-1.0, known[0], 0.7, known[17], np.nextafter(known[17], 0), 1e12):
        assert rows_before(found, moment, 90.0) == rows_before(known, moment, 90.0)
        for start, end in ((moment, 90.0), (0.5, moment)):
            rows = rows_within(found, start, end)
            assert np.array_equal(known[rows], known[(known >= start) & (known <= end)])
    words = np.where(some, None, "a")
    assert runs(found, words, 0.1) == runs(known, words, 0.1)
    values = np.where(some, np.nan, np.arange(len(ticks)) % 40)
    for stretches in (10, 4000):
        pairs = zip(
            astuple(envelope(found, values, stretches, 0.15)),
            astuple(envelope(known, values, stretches, 0.15)),
            strict=True,
        )
        assert all(np.array_equal(one, other, equal_nan=True) for one, other in pairs)


def test_times_without_a_grid_need_not_ascend() -> None:
    """A clock was set back: a minute has the rows of that minute, also those that came later."""
    times = np.array([0.0, 1.0, 2.0, 3.0, 0.5, 1.5, 2.5])
    assert times[rows_within(times, 1.0, 2.0)].tolist() == [1.0, 2.0, 1.5]
