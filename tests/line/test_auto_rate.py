"""`rate_hz = "auto"`: the rate for each response time, where it is reported, what is refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import Plan, make_plan
from jbclog.cli.progress import EventFilter
from jbclog.config.line import parse_line
from jbclog.config.load_recipe import parse_recipe
from jbclog.core.clock import UtcOffset, VirtualClock
from jbclog.core.errors import StartRefused
from jbclog.core.rows import COLUMN, NoJournal
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.family import FAMILIES
from jbclog.session.rates import readings_for
from jbclog.session.run.context import SessionContext
from jbclog.session.run.pace import choose_pace
from jbclog.session.run.state import PortState
from jbclog.session.scheduler import AUTO_RATES_HZ, CEILING, KEPT_BY_AUTO, Demand
from support.command import PROFILES, RECIPE
from support.invoked import invoked
from support.virtual.lines import fault
from support.virtual.virtual_run import RECIPE as SETTINGS
from support.virtual.virtual_run import VirtualRun, line_text, prepare
from support.virtual.virtual_run import order_for as order_of

AUTO = SETTINGS + '\n[sampling]\nrate_hz = "auto"\n'


def slow(turnaround_ms: float, ports: str = "ports = [1, 2]") -> str:
    return line_text("", ports).replace("turnaround_ms = 1.0", f"turnaround_ms = {turnaround_ms}")


def desk_of(
    family: str, ports: tuple[int, ...], usual_ms: float, longest_ms: float, recipe: str = ""
) -> SessionContext:
    """Return the context of a station whose response time has been measured."""
    head = (
        f'[recipe]\nname = "test"\nrevision = 1\nfamilies = ["{family}"]\n[sampling]\nrate_hz ='
        f' "auto"\n{recipe}'
    )
    text = f'[line]\nname = "one"\n[[station]]\nname = "one-1"\nurl = "one"\nfamily = "{family}"\n'
    (spec,) = parse_line(text, Path("line.toml")).stations
    clock = VirtualClock()
    context = SessionContext.of(
        order_of(spec, parse_recipe(head), clock, 10.0, None), NoJournal(), UtcOffset(clock)
    )
    context.state.ports.update({number: PortState(number, 2) for number in ports})
    context.state.facts.turnaround_us = {
        "median": usual_ms * 1000,
        "p99": longest_ms * 1000,
        "n": 12,
    }
    return context


def taken(
    family: str, ports: tuple[int, ...], usual_ms: float, longest_ms: float | None = None
) -> float:
    pace = choose_pace(
        desk_of(family, ports, usual_ms, usual_ms if longest_ms is None else longest_ms)
    )
    return round(1 / pace.period_s, 9)


def ready(run: VirtualRun) -> str:
    (event,) = run.memory.of_kind("station.ready")
    return event.text


# -- what is taken ---------------------------------------------------------------------------------


@pytest.mark.parametrize("turnaround_ms", [0.0, 0.9, 1.41, 1.44, 1.48, 2.0, 5.0])
def test_two_ports_take_5_hz_wherever_10_was_a_coin_toss(turnaround_ms: float) -> None:
    """10 Hz was accepted at 1.41 ms and refused at 1.48; with a reserve of one fifth, two ports
    never reach it.
    """
    run = prepare(slow(turnaround_ms), AUTO, duration_s=20).go()
    assert (run.facts.outcome, run.facts.rate_hz, run.facts.period_s) == ("completed", 5, 0.2)
    assert run.facts.asked_rate == "auto"
    assert set(run.memory.column("quality")) == {"ok"}
    assert run.facts.worst_slow_periods <= CEILING


def test_noise_around_a_response_time_changes_nothing() -> None:
    """Response times as measured for one station at different starts, up to twice the usual."""
    for number in range(200):
        usual_ms = 1.4 * math.exp(0.35 * math.sin(number))
        assert taken("dde", (1, 2), usual_ms, 3 * usual_ms) == 5
        assert taken("ucr", (1,), usual_ms, 3 * usual_ms) == 10


@pytest.mark.parametrize(
    ("family", "ports"),
    [("dde", (1, 2)), ("ucr", (1,)), ("ale", (1,)), ("dme", (1, 2, 3, 4)), ("jtse", (1,))],
)
def test_it_is_the_highest_that_leaves_a_fifth_free_and_none_lower_than_the_slow_readings_need(
    family: str, ports: tuple[int, ...]
) -> None:
    recipe = parse_recipe(f'[recipe]\nname = "test"\nrevision = 1\nfamilies = ["{family}"]\n')
    demand = Demand.of(readings_for(FAMILIES[family], ports, recipe, LineFormat(), True))
    seen = set()
    for step in range(180):
        turnaround_s = 0.0001 * 1.05**step  # to 0.65 s
        rate_hz = demand.auto_rate_hz(turnaround_s, turnaround_s)
        seen.add(rate_hz)
        higher = [one for one in AUTO_RATES_HZ if one > rate_hz]
        assert not any(
            demand.load(one, turnaround_s) <= 0.8 and demand.fits(one, turnaround_s)
            for one in higher
            if rate_hz
        )
        if rate_hz:
            assert demand.load(rate_hz, turnaround_s) <= 0.8
            assert rate_hz >= demand.slowest_rate_hz
        else:
            assert all(
                demand.load(one, turnaround_s) > 0.8 or not demand.fits(one, turnaround_s)
                for one in (0.5, 0.4, 0.2)
            )
    assert len(seen) >= 5


def test_the_borders_of_the_usual_stations() -> None:
    """In ms of response time. Real response times (1 to 2 ms, 16 ms with the timer of a USB
    adapter) are not near a border.
    """
    recipe = parse_recipe('[recipe]\nname = "test"\nrevision = 1\nfamilies = ["dde"]\n')

    def border_ms(ports: tuple[int, ...], rate_hz: float) -> float:
        demand = Demand.of(readings_for(FAMILIES["dde"], ports, recipe, LineFormat(), True))
        return 1000 * demand.greatest_turnaround_s(rate_hz, KEPT_BY_AUTO)

    assert border_ms((1, 2), 10) == pytest.approx(-1.01, abs=0.01)  # the bytes alone are too many
    assert border_ms((1, 2), 5) == pytest.approx(11.50, abs=0.01)
    assert border_ms((1, 2), 4) == pytest.approx(17.56, abs=0.01)
    assert border_ms((1,), 10) == pytest.approx(11.99, abs=0.01)
    assert border_ms((1, 2, 3, 4), 4) == pytest.approx(1.78, abs=0.01)


@pytest.mark.parametrize(
    ("usual_ms", "longest_ms", "rate_hz"),
    [(5, 20, 1), (125, 249, 1), (125, 250, 1), (246, 250, 1), (257, 260, 0.5), (30, 340, 0.5)],
)
def test_an_omega_is_held_against_the_longest_answer_that_its_manual_prints(
    usual_ms: float, longest_ms: float, rate_hz: float
) -> None:
    """Manual 003, 11.1: 0 to 250 ms. Quick first answers do not exclude slow later ones."""
    assert taken("omega", (1,), usual_ms, longest_ms) == rate_hz


def test_each_station_has_a_link_and_so_a_rate_of_its_own() -> None:
    one_port = line_text("", "ports = [1]").split("[[station]]")[1].replace("dde-1", "dde-2")
    run = prepare(line_text() + "\n[[station]]" + one_port, AUTO, duration_s=5).go()
    assert {name: facts.rate_hz for name, facts in run.memory.stations.items()} == {
        "dde-1": 5,
        "dde-2": 10,
    }


def test_a_station_that_takes_longer_to_measure_is_asked_so_often_as_that_allows() -> None:
    """A station takes 6 ms longer to measure a temperature than to send the stored values that were
    read before; at the chosen rate no tick is skipped.
    """
    slow_to_measure = fault("late", at_s=0.0, by_s=0.006, command="tip_temperature", every=1)
    run = prepare(line_text(slow_to_measure, "ports = [1]"), AUTO, duration_s=20).go()
    before = [one.text for one in run.heard[: run.heard.index(run.writes[0])]]
    assert (before.count("RTT1"), before.count("RSER")) == (3, 0)
    assert run.facts.turnaround_us["n"] == 9
    assert run.facts.turnaround_us["median"] == pytest.approx(7_000, abs=100)
    assert run.facts.rate_hz == 10
    ticks = [row[COLUMN["tick"]] for row in run.memory.samples]
    assert ticks == [*range(ticks[0], ticks[0] + len(ticks))]
    assert set(run.memory.column("quality")) == {"ok"}
    assert run.facts.worst_slow_periods <= CEILING


# -- what else is asked for ------------------------------------------------------------------------


def test_an_option_asks_for_it_and_wins_over_the_recipe() -> None:
    assert (
        prepare(slow(1.0), SETTINGS + "\n[sampling]\nrate_hz = 2\n", duration_s=2, rate="auto")
        .go()
        .facts.rate_hz
        == 5
    )
    assert prepare(slow(1.0), AUTO, duration_s=2, rate=2).go().facts.rate_hz == 2


def test_fit_takes_up_to_the_usual_rate_where_the_recipe_says_auto() -> None:
    facts = prepare(slow(3.0), AUTO, duration_s=2, rate="fit").go().facts
    assert facts.asked_rate == "fit"
    assert facts.rate_hz is not None
    assert 8 < facts.rate_hz < 10
    assert (
        prepare(slow(1.0, "ports = [1]"), AUTO, duration_s=2, rate="fit").go().facts.rate_hz == 10
    )


def test_a_number_stays_a_demand_and_a_missing_key_is_the_usual_number() -> None:
    refused = prepare(slow(1.6), SETTINGS, duration_s=2).go().facts
    assert (refused.outcome, refused.asked_rate, refused.rate_hz) == ("refused", 10, None)
    kept = prepare(slow(1.0), SETTINGS, duration_s=2).go().facts
    assert (kept.outcome, kept.asked_rate, kept.rate_hz) == ("completed", 10, 10)


def test_without_pause_there_is_no_rate() -> None:
    facts = prepare(slow(1.0), AUTO, duration_s=2, rate="max").go().facts
    assert (facts.asked_rate, facts.rate_hz, facts.period_s) == ("max", None, None)


def test_where_no_rate_is_left_the_refusal_says_what_would_be() -> None:
    """Flags every 0.1 s need at least 3.33 Hz. With a reserve of one fifth, two ports reach at most
    4 Hz at 16 ms, and less at 25 ms.
    """
    context = desk_of("dde", (1, 2), 25, 25, "alarms_every_s = 0.1\n")
    with pytest.raises(
        StartRefused,
        match=r'"auto" finds no rate: .*3\.33 Hz.*25\.00 ms response time; raise alarms_every_s',
    ):
        choose_pace(context)
    run = prepare(slow(25.0), AUTO + "alarms_every_s = 0.1\n", duration_s=2).go()
    assert run.facts.outcome == "refused"
    assert run.writes == []


# -- where it is told ------------------------------------------------------------------------------


def test_what_was_taken_is_told_when_a_station_is_ready_and_shown() -> None:
    run = prepare(slow(1.0), AUTO, duration_s=2).go()
    assert ready(run).endswith(", sampled at 5 Hz (auto: a fifth of its link stays free).")
    (event,) = run.memory.of_kind("station.ready")
    assert EventFilter().passes(event)
    assert "sampled at 9 Hz (fit: the best rate that fits)" in ready(
        prepare(slow(3.0), AUTO, duration_s=2, rate="fit").go()
    )
    assert "sampled at" not in ready(prepare(slow(1.0), AUTO, duration_s=2, rate=2).go())


def bench_plan(turnaround_ms: float | None, tmp_path: Path) -> Plan:
    text = (PROFILES / "lines" / "bench.toml").read_text()
    if turnaround_ms is not None:
        text = text.replace('family = "dde"', f'family = "dde"\nturnaround_ms = {turnaround_ms}')
    (tmp_path / "line.toml").write_text(text)
    return make_plan(RunOptions(tmp_path / "line.toml", RECIPE))


def test_a_plan_names_what_it_assumes_and_what_it_would_take(tmp_path: Path) -> None:
    bench_plan(None, tmp_path)
    told = invoked("plan", "--verbose", RECIPE, "--line", tmp_path / "line.toml").stdout
    assert "a fifth of the link free: 5 Hz up to 11.50 ms response time" in told
    assert "a fifth of the link free: 10 Hz up to 11.98 ms response time" in told
    assert "assumed   0 ms: the line file has no turnaround_ms" in told
    bench_plan(16.0, tmp_path)
    said = invoked("plan", "--verbose", RECIPE, "--line", tmp_path / "line.toml").stdout
    assert "4 Hz up to 17.56 ms" in said
    assert "assumed   turnaround_ms of the line file" in said
    first, *_ = json.loads(
        invoked("plan", RECIPE, "--line", tmp_path / "line.toml", "--json").stdout
    )["stations"]
    names = ("asked_rate", "rate_hz", "assumed_turnaround_ms", "auto_up_to_turnaround_ms")
    assert [first[name] for name in names] == ["auto", 4, 16, pytest.approx(17.56, abs=0.01)]


def test_what_the_bare_link_cannot_carry_is_an_error_of_the_plan(tmp_path: Path) -> None:
    line = tmp_path / "line.toml"
    line.write_text(
        '[line]\nname = "one"\n[[station]]\nname = "dde-1"\nurl = "dde-1"\nfamily = "dde"\nbaudrate'
        " = 1200\n"
    )
    recipe = tmp_path / "recipe.toml"
    recipe.write_text(AUTO + "alarms_every_s = 0.1\n")
    ended = invoked("plan", recipe, "--line", line)
    assert ended.exit_code == 2
    assert '"auto" finds no rate' in ended.output


def test_a_plan_takes_what_a_run_takes_at_the_same_response_time(tmp_path: Path) -> None:
    for turnaround_ms in (0.0, 1.4, 11.0, 12.0, 17.0, 19.0, 60.0):
        planned = [station.rate_hz for station in bench_plan(turnaround_ms, tmp_path).stations]
        assert planned[0] == taken("dde", (1, 2), turnaround_ms)
        assert replace(bench_plan(turnaround_ms, tmp_path).stations[0], rate=3.0).rate_hz == 3
