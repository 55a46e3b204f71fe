"""The arithmetic of one wire, against numbers worked out by hand, and what the plan promises,
against a simulated wire.
"""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from support.product import (
    BAUDRATES,
    FAMILIES,
    SLOW_CEILING,
    Demand,
    Grid,
    LineFormat,
    Recipe,
    ScheduledRead,
    SlowReadings,
    parse_recipe,
    read_wire_s,
    readings_for,
    too_fast,
)
from support.virtual.virtual_run import RECIPE

DDE = FAMILIES["dde"]
LINE = LineFormat(19200, "8N1")
OMEGA = '[recipe]\nname = "x"\nrevision = 1\nfamilies = ["omega"]\n'


def recipe_with(alarms_every_s: float = 2, counters_every_s: float = 60) -> Recipe:
    return parse_recipe(
        f"{RECIPE}\n[sampling]\nalarms_every_s = {alarms_every_s}\ncounters_every_s ="
        f" {counters_every_s}\n"
    )


def fast_only(ports: int, line: LineFormat = LINE) -> Demand:
    """Temperature, power and status of that many ports."""
    readings = readings_for(DDE, range(1, ports + 1), recipe_with(), line, True)
    return Demand.of(one for one in readings if one.period_s is None)


def everything(ports: int) -> Demand:
    return Demand.of(readings_for(DDE, range(1, ports + 1), recipe_with(), LINE, True))


# -- numbers worked out by hand --------------------------------------------------------------------


def test_a_read_and_its_answer_are_27_characters() -> None:
    # 14.06 ms
    assert read_wire_s(LINE, DDE.commands["tip_temperature"], True) == pytest.approx(
        27 * 10 / 19200
    )
    # 9.9 ms
    assert read_wire_s(LINE, DDE.commands["tip_temperature"], False) == pytest.approx(
        19 * 10 / 19200
    )
    assert read_wire_s(LINE, DDE.commands["transformer_temperature"], True) == pytest.approx(
        25 * 10 / 19200
    )
    assert read_wire_s(LineFormat(1200, "8E2"), DDE.commands["power"], True) == pytest.approx(
        27 * 12 / 1200
    )


def test_the_wire_time_of_an_omega() -> None:
    """STX A ETX 4 1, and STX a 0 ETX 9 1: five characters and six (003, 11.2)."""
    line, commands = LineFormat(9600), FAMILIES["omega"].commands
    assert read_wire_s(line, commands["information"], False) == pytest.approx(11 * 10 / 9600)
    demand = Demand.of(readings_for(FAMILIES["omega"], (1,), parse_recipe(OMEGA), line, False))
    assert demand.tick_s(0.25) == pytest.approx(3 * (11 * 10 / 9600 + 0.25))
    assert demand.best_rate_hz(0.25) == 1.2
    assert demand.fits(1.0, 0.3)
    assert not demand.fits(1.3, 0.25)


@pytest.mark.parametrize(("turnaround_ms", "slow_reads_per_s"), [(0, 11.1), (2, 2.26), (2.6, 0.06)])
def test_what_two_ports_at_10_hz_leave_for_slow_reads(
    turnaround_ms: float, slow_reads_per_s: float
) -> None:
    """11 at no turnaround, 2 at 2 ms, none from 2.6 ms on."""
    turnaround_s = turnaround_ms / 1000
    free = 1 - fast_only(2).load(10, turnaround_s)
    assert free / (LINE.read_s() + turnaround_s) == pytest.approx(slow_reads_per_s, abs=0.05)


@pytest.mark.parametrize(
    ("ports", "turnaround_ms", "rate_hz"),
    [(4, 0, 5.926), (2, 16, 5.544), (2, 0, 11.85), (1, 0, 23.7)],
)
def test_the_rate_at_which_fast_reads_fill_the_whole_wire(
    ports: int, turnaround_ms: float, rate_hz: float
) -> None:
    """Four ports reach 5.9 Hz; a USB adapter's 16 ms bring two ports down to 5.5 Hz."""
    assert fast_only(ports).load(rate_hz, turnaround_ms / 1000) == pytest.approx(1, abs=1e-3)


def test_five_percent_are_kept() -> None:
    two = fast_only(2)
    assert two.best_rate_hz(0) == 11.2  # 0.95 / (6 × 14.0625 ms) = 11.26
    assert two.greatest_turnaround_s(10) == pytest.approx(0.95 / 60 - 0.0140625)


def test_the_products_own_profile_fits() -> None:
    """Two ports, three fast signals, all slow ones, counters, 10 Hz, 1 ms; by hand 90.4 % fast and
    1.9 % slow.
    """
    profile = everything(2)
    assert profile.load(10, 0.001) == pytest.approx(0.904 + 0.019, abs=0.001)
    assert profile.fits(10, 0.001)
    assert not profile.fits(10, 0.0015)
    assert not profile.fits(10.4, 0.001)


def test_a_refusal_names_the_best_rate_and_the_greatest_turnaround() -> None:
    profile = everything(2)
    best, most = profile.best_rate_hz(0.003), profile.greatest_turnaround_s(10)
    text = too_fast("dde-1", 10, profile, 0.003)
    assert f"best rate is {best:g} Hz" in text
    assert f"{most * 1000:.2f} ms at most" in text
    assert "the bytes alone are too many" in too_fast("dde-1", 20, profile, 0.003)


# -- what is promised, on a wire that is simulated -------------------------------------------------


@dataclass(frozen=True)
class Wire:
    """A wire with everything that a run reads on it."""

    readings: list[ScheduledRead]
    turnaround_s: float

    @property
    def demand(self) -> Demand:
        return Demand.of(self.readings)


@st.composite
def wires(draw: st.DrawFn) -> Wire:
    family = FAMILIES[draw(st.sampled_from(["dde", "ucr", "ale", "dme"]))]
    ports = draw(st.sets(st.sampled_from(family.ports or (1, 2)), min_size=1))
    alarms_s, counters_s = draw(st.floats(0.1, 30)), draw(st.floats(1, 300))
    line = LineFormat(draw(st.sampled_from(BAUDRATES)))
    readings = readings_for(
        family,
        sorted(ports),
        recipe_with(round(alarms_s, 2), round(counters_s, 1)),
        line,
        draw(st.booleans()),
    )
    return Wire(readings, draw(st.floats(0, 0.06)))


@dataclass
class Seen:
    worst_periods: float = 0.0
    latest_s: float = 0.0
    skipped: int = 0


def simulate(wire: Wire, rate_hz: float, seconds: float) -> Seen:
    """Run the executive on a wire on which everything takes what the plan reckons with."""
    grid, demand, seen = Grid(0.0, 1 / rate_hz), wire.demand, Seen()
    slow = SlowReadings(
        wire.readings,
        0.0,
        longest_s=demand.longest_slow_s(wire.turnaround_s),
        tick_s=grid.period_s,
        runs_over=demand.runs_over(rate_hz, wire.turnaround_s),
    )
    now, tick = 0.0, 0
    while now < seconds:
        now = max(now, grid.due(tick))
        seen.latest_s = max(seen.latest_s, now - grid.due(tick))
        now += demand.tick_s(wire.turnaround_s)
        while (one := slow.next(now, grid.due(tick + 1))) is not None:
            now += one.reading.wire_s + wire.turnaround_s
            slow.taken(one, now, grid.due(tick + 1))
            if now > grid.due(tick + 1):
                break
        following = grid.next_after(tick, now)
        seen.skipped += following - tick - 1
        tick = following
    ages = [(now - one.last) / one.period_s for one in slow.all_due(float("inf"))]
    seen.worst_periods = max(slow.worst_periods, *ages)
    return seen


@settings(max_examples=80, deadline=None)
@given(wires(), st.floats(0.05, 1))
def test_what_fits_keeps_every_tick_and_every_ceiling(wire: Wire, share: float) -> None:
    best = wire.demand.best_rate_hz(wire.turnaround_s)
    rate_hz = best if share > 0.5 else max(best * share, 0.01)
    assume(wire.demand.fits(rate_hz, wire.turnaround_s))
    longest_s = max(one.period_s or 0 for one in wire.readings)
    seen = simulate(wire, rate_hz, min(2.5 * longest_s, 3000 / rate_hz))
    assert seen.worst_periods <= SLOW_CEILING
    assert seen.skipped == 0
    assert seen.latest_s <= wire.demand.longest_slow_s(wire.turnaround_s) + 1e-9


@pytest.mark.parametrize("too_much", [1.1, 1.5, 3])
def test_where_too_much_has_to_be_asked_ticks_are_skipped_and_slow_signals_are_not_forgotten(
    too_much: float,
) -> None:
    """A line on which many reads are repeated is a line with too high a rate."""
    wire = Wire(readings_for(DDE, (1, 2), recipe_with(), LINE, True), 0.001)
    seen = simulate(wire, too_much * wire.demand.best_rate_hz(0.001), 200)
    assert seen.skipped > 0
    assert seen.worst_periods <= SLOW_CEILING


@settings(max_examples=150, deadline=None)
@given(wires(), st.floats(0.1, 50))
def test_best_rate_and_greatest_turnaround_are_the_inverse_of_fits(
    wire: Wire, rate_hz: float
) -> None:
    demand, best = wire.demand, wire.demand.best_rate_hz(wire.turnaround_s)
    grain = 0.1 if best >= 1 else 0.01
    assert best == 0 or demand.fits(best, wire.turnaround_s)
    assert not demand.fits(best + grain, wire.turnaround_s)
    most = demand.greatest_turnaround_s(rate_hz)
    assert demand.fits(rate_hz, most)
    assert not demand.fits(rate_hz, most + 1e-7)


def test_slow_readings_run_into_the_next_tick_only_where_they_must() -> None:
    roomy, tight = everything(1), everything(2)
    assert not roomy.runs_over(10, 0.001)  # 55 ms free a tick: three whole readings
    assert tight.runs_over(10, 0.001)  # 9.6 ms free a tick: none


# -- the grid --------------------------------------------------------------------------------------


def test_ticks_lie_on_an_absolute_grid() -> None:
    grid = Grid(1000.0, 0.1)
    assert [grid.due(tick) for tick in (0, 1, 100_000)] == pytest.approx(
        [1000.0, 1000.1, 11_000.0], abs=1e-9
    )
    assert [grid.first_from(moment) for moment in (1000.0, 1000.05, 1000.1)] == [0, 1, 1]


@pytest.mark.parametrize(
    ("now", "following"),
    [(1000.05, 8), (1000.799, 8), (1000.8, 8), (1000.899, 8), (1000.9, 9), (1003.05, 30)],
)
def test_a_late_tick_is_run_late_and_a_whole_period_late_is_skipped(
    now: float, following: int
) -> None:
    """Tick 7 was done at `now`; tick 8 is due at 1000.8."""
    assert Grid(1000.0, 0.1).next_after(7, now + 1e-9) == following


def test_no_reading_is_taken_twice_in_a_row() -> None:
    """After a pause each is due once, not once for every period that it missed."""
    slow = SlowReadings(readings_for(DDE, (1,), recipe_with(), LINE, True), 0.0)
    taken = []
    while (one := slow.next(3600.0, float("inf"))) is not None:
        slow.taken(one, 3600.0)
        taken.append(one.reading.name)
    assert (
        len(taken)
        == len(set(taken))
        == sum(
            one.period_s is not None for one in readings_for(DDE, (1,), recipe_with(), LINE, True)
        )
    )


def test_counters_are_due_a_period_after_the_start() -> None:
    slow = SlowReadings(readings_for(DDE, (1,), recipe_with(counters_every_s=60), LINE, True), 0.0)
    due = {one.reading.name: one.due for one in slow.all_due(float("inf"))}
    assert due["work_h"] == 60
    assert due["alarm_high"] == 0
