"""Counter totals against a naive reference: every thing that can have happened between two looks is
tried, one after the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.maintenance.counter_totals.history import History
from jbclog.maintenance.counter_totals.observed import Observation
from jbclog.maintenance.counter_totals.totals import Trace
from jbclog.maintenance.counter_totals.tracing import traces_of
from support.fleets.audit_fleet import Fleet
from support.fleets.looks import last, rules, seen, traced

FASTEST = {"plugged_h": None, "work_h": None, "sleep_cycles": 60.0}
HOURS = st.one_of(st.integers(0, 40), st.integers(0, 9000), st.integers(99_900, 99_999))
COUNTS = st.one_of(st.integers(0, 200), st.integers(0, 99_998), st.integers(99_900, 99_998))
GAPS = st.sampled_from([0.02, 1.0, 24.0, 168.0, 4380.0])
TOP = 99_999


@dataclass(frozen=True)
class Happened:
    """One explanation: what each counter did, at least and at most; of a reset, what was lost is
    not known.
    """

    reset: bool
    worked: tuple[tuple[float, float], ...]


def explanations(before: list[int], after: list[int], hours: float) -> list[Happened]:
    """All that the manuals and time allow, tried one by one: no reset with 0 to 3 roll-overs of
    each, or a reset of all.
    """
    found = []
    # at its last number it may stand still, and tells nothing
    plugged = after[0] - before[0] if after[0] < TOP else -1
    for turns in product(range(4), repeat=len(before)):
        grown = [
            new - old + 100_000 * times
            for old, new, times in zip(before, after, turns, strict=True)
        ]
        if all(
            0 <= one <= _most(name, hours, plugged)
            for one, name in zip(grown, FASTEST, strict=True)
        ):
            steps = [0 if rate else 1 for rate in FASTEST.values()]
            found.append(
                Happened(
                    False,
                    tuple(
                        (max(0, one - step), one + step)
                        for one, step in zip(grown, steps, strict=True)
                    ),
                )
            )
    if all(
        new <= hours * (rate or 1.01) for new, rate in zip(after, FASTEST.values(), strict=True)
    ):
        found.append(Happened(True, tuple((new, new) for new in after)))
    return found


def _most(name: str, hours: float, plugged: int) -> float:
    rate = FASTEST[name]
    if rate is None:
        return hours * 1.01 + 1
    return rate * (min(hours * 1.01, plugged + 1) if plugged >= 0 else hours * 1.01)


@given(
    st.tuples(HOURS, HOURS, COUNTS),
    st.tuples(HOURS, HOURS, COUNTS),
    st.tuples(*[st.integers(0, 60)] * 3),
    GAPS,
    st.integers(0, 2),
)
def test_known_is_what_only_one_thing_explains(
    before: tuple[int, ...], other: tuple[int, ...], grown: tuple[int, ...], gap: float, how: int
) -> None:
    after = [
        list(other),
        [(old + more) % 100_000 for old, more in zip(before, grown, strict=True)],
        list(grown),
    ][how]
    found = _traces(list(before), after, gap)
    if found is None:
        return
    possible = explanations(list(before), after, gap)
    if any(new < old for old, new in zip(before, after, strict=True)):  # a person must say why
        for place, trace in enumerate(found):
            delta = last(trace).delta
            assert not last(trace).is_known
            for happened in possible:  # whole hours are one hour wide
                low, high = happened.worked[place]
                assert delta.low <= low
                assert high <= delta.high + 2
        return
    if not possible:
        assert not all(last(trace).is_known for trace in found)
        return
    for place, trace in enumerate(found):
        one = last(trace)
        if after[place] >= TOP or not any(after):
            continue
        ranges = {(happened.reset, happened.worked[place]) for happened in possible}
        assert one.is_known == (len(ranges) == 1 and not next(iter(ranges))[0]), (one, ranges)
        assert all(
            one.delta.low <= low and high <= one.delta.high + 1e-6 for _, (low, high) in ranges
        ), (one, ranges)


def _traces(before: list[int], after: list[int], gap: float) -> list[Trace] | None:
    """None where the counters are rather another station's."""
    looks = [
        seen(place * gap, dict(zip(FASTEST, shown, strict=True)))
        for place, shown in enumerate((before, after))
    ]
    traces = [
        trace
        for _, trace in sorted(
            traced(looks).now.items(), key=lambda one: list(FASTEST).index(one[0][1])
        )
    ]
    return traces if all(trace.differences for trace in traces) else None


# -- whole histories -------------------------------------------------------------------------------

Steps = list[tuple[float, float, str]]
EVENTS = st.sampled_from(["", "", "", "reset", "exchange"])
WORKED = st.lists(
    st.tuples(st.sampled_from([1.0, 24.0, 168.0, 2000.0]), st.floats(0, 1), EVENTS),
    min_size=1,
    max_size=25,
)


@given(st.floats(0, 99_999), st.floats(0, 99_999), WORKED)
def test_sums_hold_what_was_worked(plugged: float, cycles: float, steps: Steps) -> None:
    """A box that was always on and worked a share of it; any step may begin with a reset, or with
    another box, whose hours are no continuation.
    """
    clock, on, work, events = 0.0, plugged, plugged / 2, int(cycles)
    real_on, real_events = 0.0, 0
    looks = [_look(clock, on, work, events)]
    for hours, share, event in steps:
        if event == "reset":
            on, work, events = 0.0, 0.0, 0
        elif event == "exchange":
            on, work, events = (on + 50_000) % 99_999, (work + 30_000) % 99_999, events + 700
        clock, on, work = clock + hours, on + hours, work + hours * share
        made = int(hours * share * 3)
        events, real_on, real_events = events + made, real_on + hours, real_events + made
        looks.append(_look(clock, on, work, events))
    now = traced(looks).now
    for name, real, step in (("plugged_h", real_on, 1.0), ("sleep_cycles", real_events, 0.0)):
        odometer = now[1, name].counter_total
        if not now[1, name].differences or odometer.since != looks[0].time:
            continue
        assert odometer.total.low - 1e-6 <= real <= odometer.total.high + 1e-6, (
            name,
            real,
            odometer,
            rules(now[1, name]),
        )
        assert not odometer.is_known or odometer.total.width <= 2 * step


def _look(clock: float, on: float, work: float, events: int) -> Observation:
    return seen(
        clock,
        {
            "plugged_h": int(on) % 100_000,
            "work_h": int(work) % 100_000,
            "sleep_cycles": events % 100_000,
        },
    )


# -- simulated years -------------------------------------------------------------------------------


@pytest.mark.parametrize("every_h", [24.0, 168.0, 730.0])
def test_bounds_hold_over_a_year_of_resets_exchanges_and_wrong_clocks(every_h: float) -> None:
    fleet = Fleet(every_h=every_h, years=1.0, truth_years=1.0, resets=1.0, swaps=0.5, misread=0.0)
    checked = fell = 0
    for number in range(6):
        station = fleet.station(501, number)
        history = History("line", station.name, station.seen, station.facts)
        for key, trace in traces_of(history).now.items():
            for place, change in enumerate(trace.differences):
                begin, end = (trace.points[at].look for at in (place, place + 1))
                worked = station.true(key, station.moments[end])
                worked -= station.true(key, station.moments[begin])
                assert change.delta.low - 1e-6 <= worked <= change.delta.high + 1e-6, change
                checked += 1
                fell += change.rule == "fell"
    assert fell
    assert checked > 300
