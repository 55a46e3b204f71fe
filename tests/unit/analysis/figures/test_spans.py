"""Stretches of time: states, and what is too short to be seen."""

from __future__ import annotations

import numpy as np

from jbclog.analysis.figures.curves import Span, merged, runs, widened


def test_runs_of_the_same_word() -> None:
    seconds = np.arange(8) / 10
    words = ["working", "working", None, "stand", "stand", "sleep", None, "sleep"]
    found = [
        (round(span.start, 3), round(span.end, 3), span.word) for span in runs(seconds, words, 0.1)
    ]
    assert found == [
        (0, 0.2, "working"),
        (0.3, 0.5, "stand"),
        (0.5, 0.6, "sleep"),
        (0.7, 0.8, "sleep"),
    ]


def test_a_missing_tick_ends_a_run() -> None:
    assert [
        (span.start, span.end) for span in runs(np.array([0.0, 1.0, 5.0]), ["a", "a", "a"], 1.0)
    ] == [(0, 2), (5, 6)]


def test_nothing_has_no_runs() -> None:
    assert runs(np.empty(0), [], 0.1) == []
    assert runs(np.array([1.0]), [None], 0.1) == []


def test_spans_too_close_to_be_told_apart_are_one() -> None:
    spans = [
        Span(0, 1, "timeout"),
        Span(1.4, 2, "timeout"),
        Span(2.1, 3, "disconnected"),
        Span(9, 10, "disconnected"),
    ]
    assert merged(spans, 0.5) == [
        Span(0, 2, "timeout"),
        Span(2.1, 3, "disconnected"),
        Span(9, 10, "disconnected"),
    ]


def test_a_sliver_is_made_wide_enough_and_the_rest_is_left_alone() -> None:
    assert widened(Span(10, 10.1, "x"), 1.0).seconds == 1.0
    assert widened(Span(10, 12, "x"), 1.0) == Span(10, 12, "x")
