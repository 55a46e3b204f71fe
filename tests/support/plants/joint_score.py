"""How well joints were found: which found one is which true one, F1, the worst tenth, and what was
taken for what.

The rule, fixed before anything was tuned: one true joint and one found joint are the same where
they overlap for at least half of the shorter of the two; each counts once. Left out on both sides:
what touches a gap of the record (half a second around it), and what cannot be told apart
(`UNTOLD`). What may be one joint or two (`EITHER`) is found where one of them is. Every other found
joint is a false one, of the class that it overlaps or comes within a second of.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from support.plants.second_plant import EITHER, UNTOLD, Trial, Truth

Interval = tuple[float, float]
BESIDE_S = 1.0
AROUND_GAP_S = 0.5


@dataclass
class Score:
    """Of one trial or of many: true joints found and missed, found ones that are none."""

    hit: Counter[str] = field(default_factory=Counter)
    missed: Counter[str] = field(default_factory=Counter)
    false: Counter[str] = field(default_factory=Counter)
    events: Counter[str] = field(default_factory=Counter)
    # what cannot be told apart, and was taken for a joint
    untold: Counter[str] = field(default_factory=Counter)

    @property
    def f1(self) -> float:
        """2 · hits / (2 · hits + missed + false)."""
        hits, wrong = self.hit.total(), self.missed.total() + self.false.total()
        return 2 * hits / (2 * hits + wrong) if hits + wrong else 1.0

    def add(self, other: Score) -> None:
        for name in ("hit", "missed", "false", "events", "untold"):
            getattr(self, name).update(getattr(other, name))


def overlap(one: Interval, other: Interval) -> float:
    return min(one[1], other[1]) - max(one[0], other[0])


def same(truth: Interval, found: Interval) -> bool:
    return overlap(truth, found) >= 0.5 * min(truth[1] - truth[0], found[1] - found[0])


def score(trial: Trial, found: Sequence[Interval]) -> Score:
    """Compare the found joints of a trial with the true ones."""
    result, left = Score(), [joint for joint in found if not _at_gap(trial, joint)]
    for truth in trial.truths:
        place = truth.start, truth.end
        if _at_gap(trial, place):
            left = [joint for joint in left if overlap(place, joint) <= 0]
            continue
        result.events[truth.kind] += 1
        fitting = [joint for joint in left if truth.is_joint and same(place, joint)]
        if fitting:
            left.remove(max(fitting, key=lambda joint: overlap(place, joint)))
            if truth.kind in EITHER:
                left = [joint for joint in left if overlap(place, joint) <= 0]
        if truth.is_joint:
            (result.hit if fitting else result.missed)[truth.kind] += 1
    for joint in left:
        kind = _nearest(trial.truths, joint)
        (result.untold if kind in UNTOLD else result.false)[kind] += 1
    return result


def _at_gap(trial: Trial, place: Interval) -> bool:
    return any(
        overlap(place, (start - AROUND_GAP_S, end + AROUND_GAP_S)) > 0 for start, end in trial.gaps
    )


def _nearest(truths: Sequence[Truth], joint: Interval) -> str:
    beside = max(truths, key=lambda truth: overlap((truth.start, truth.end), joint), default=None)
    return (
        beside.kind
        if beside is not None and overlap((beside.start, beside.end), joint) > -BESIDE_S
        else "idle"
    )


def worst_tenth(scores: Sequence[Score]) -> Score:
    """The tenth of the trials with the lowest F1, together."""
    together = Score()
    for one in sorted(scores, key=lambda one: one.f1)[: max(len(scores) // 10, 1)]:
        together.add(one)
    return together


def all_of(scores: Sequence[Score]) -> Score:
    together = Score()
    for one in scores:
        together.add(one)
    return together


def told(scores: Sequence[Score]) -> str:
    """A table: each class with its events, how many were found or taken for joints; F1 of all and
    of the worst tenth.
    """
    every, worst = all_of(scores), worst_tenth(scores)
    lines = [f"{'class':<10} {'n':>5} {'found':>6} {'missed':>7} {'false':>6}"]
    for kind in sorted({*every.events, *every.false}):
        false = every.untold[kind] if kind in UNTOLD else every.false[kind]
        mark = " (in no F1)" if kind in UNTOLD else ""
        lines.append(
            f"{kind:<10} {every.events[kind]:>5} {every.hit[kind]:>6} {every.missed[kind]:>7}"
            f" {false:>6}{mark}"
        )
    lines.append(f"F1 {every.f1:.4f}, of the worst tenth of {len(scores)} trials {worst.f1:.4f}")
    return "\n".join(lines)
