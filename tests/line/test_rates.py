"""Ticks on a grid: the product's own profile, `--rate fit` and `max`, late ticks, and stations
beside each other.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise, takewhile

import pytest

from support.oracles.account import assert_account_holds, wrong_values
from support.product import (
    APART_S,
    COLUMN,
    LEAST_TIMED_READS,
    SLOW_CEILING,
    TIMED_READS,
    IoResult,
    PortState,
    Request,
    StartRefused,
    do,
    relay,
)
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

PERIOD_S = {
    "alarm_high": 2,
    "port_error": 2,
    "setpoint_c": 5,
    "tool": 5,
    "station_error": 5,
    "transistor_c": 10,
    "transformer_c": 10,
}
STATION_WIDE = ("station_error", "transformer_c")


def gaps_s(run: VirtualRun, column: str, port: int) -> list[float]:
    """Return the seconds between the values of a column, by its rows, with start and end of the
    run.
    """
    begin, end = run.memory.column("tick", port)[0], run.memory.column("tick", port)[-1]
    ticks = [
        row[COLUMN["tick"]]
        for row in run.memory.samples
        if row[COLUMN["port"]] == port and row[COLUMN[column]] is not None
    ]
    assert run.facts.period_s is not None
    return [
        (after - before) * run.facts.period_s for before, after in pairwise([begin, *ticks, end])
    ]  # type: ignore[operator]


def two_stations(sim: str) -> str:
    """Return a line of two stations. `sim` describes the first; the second is always the same."""
    second = line_text("noise_c = 2.0\nseed = 7").split("[[station]]")[1]
    return line_text(sim) + "\n[[station]]" + second.replace("dde-1", "dde-2")


# -- the product's own profile ---------------------------------------------------------------------


def test_ten_minutes_of_the_products_own_profile() -> None:
    """Two ports, three fast signals, all slow ones, counters, 10 Hz, 1 ms: no tick is skipped, and
    no slow signal exceeds its ceiling.
    """
    run = prepare(line_text("noise_c = 2.0"), duration_s=600).go()
    assert run.facts.outcome == "completed"
    for port in (1, 2):
        ticks = run.memory.column("tick", port)
        assert ticks == list(range(ticks[0], ticks[0] + 6000))  # type: ignore[operator, arg-type]
        assert set(run.memory.column("quality", port)) == {"ok"}
        for column, period_s in PERIOD_S.items():
            if port == 1 or column not in STATION_WIDE:
                assert max(gaps_s(run, column, port)) <= SLOW_CEILING * period_s, column
    times = [
        one.time / 1e6 for one in run.memory.counters if (one.port, one.counter) == (2, "work_h")
    ]
    assert max(after - before for before, after in pairwise(times)) <= SLOW_CEILING * 60
    assert_account_holds(run)
    assert wrong_values(run) == []


def test_nothing_drifts() -> None:
    """Due times are taken from the grid: after twenty minutes the first question is still sent when
    it is due.
    """
    run = prepare(line_text("", "ports = [1]"), duration_s=1200, rate=2).go()
    late = [value for value in run.memory.column("late_us") if isinstance(value, int)]
    assert len(late) == 2400
    assert max(late) < 100


# -- rates -----------------------------------------------------------------------------------------


def test_a_rate_that_does_not_fit_is_refused_before_the_first_write_and_names_the_best() -> None:
    run = prepare(duration_s=5, rate=12).go()
    assert run.facts.outcome == "refused"
    assert "12 Hz does not fit its serial link: " in run.facts.reason
    assert "--rate fit" in run.facts.reason
    assert run.writes == []


@pytest.mark.parametrize("turnaround_ms", [0.0, 1.0, 3.0, 16.0, 100.0])
def test_fit_takes_the_best_rate_and_keeps_it(turnaround_ms: float) -> None:
    line = line_text().replace("turnaround_ms = 1.0", f"turnaround_ms = {turnaround_ms}")
    run = prepare(line, duration_s=120, rate="fit").go()
    assert run.facts.outcome == "completed"
    assert set(run.memory.column("quality")) == {"ok"}
    assert run.facts.worst_slow_periods <= SLOW_CEILING
    assert run.facts.period_s is not None
    assert 1 / run.facts.period_s <= 10
    assert_account_holds(run)


def test_a_link_that_is_too_slow_with_pauses_too_is_refused() -> None:
    """The response time is measured again before the refusal, which states the second result."""
    line = line_text("", "ports = [1]").replace("turnaround_ms = 1.0", "turnaround_ms = 60.0")
    run = prepare(line, duration_s=5).go()
    assert run.facts.outcome == "refused"
    assert "10 Hz does not fit its serial link: " in run.facts.reason
    assert "at 60.00 ms response time" in run.facts.reason
    asked = [one for one in run.heard if one.text in ("RTT1", "RSER")]
    assert Counter(one.text for one in asked) == {
        "RTT1": LEAST_TIMED_READS + TIMED_READS // 2,
        "RSER": TIMED_READS // 2,
    }
    again = [one.at for one in asked[-TIMED_READS:]]
    assert min(after - before for before, after in pairwise(again)) > APART_S
    assert run.writes == []


def test_a_computer_that_is_late_at_the_start_is_not_taken_for_slow_stations() -> None:
    """Until the first sample, each result costs the computer 1.5 ms, and twenty stations ask at
    once: it processes an answer 30 ms after the question, though the link had it after 14 ms.
    """
    head, station = line_text("", "ports = [1]").split("[[station]]")
    names = [f"dde-{number}" for number in range(1, 21)]
    run: VirtualRun

    async def slowly(request: Request) -> IoResult:
        heard = await do(request)
        if not run.memory.samples:
            clock = run.driver.clock
            clock.advance_to(clock.monotonic() + 0.0015)
        return heard

    run = prepare(
        "[[station]]".join([head, *(station.replace("dde-1", name) for name in names)]),
        RECIPE + "\n[sampling]\nalarms_every_s = 0.2\n",
        pulled=lambda _order, session, cable: (relay(session, slowly), cable),
    )
    run.go()
    found = [run.memory.stations[name] for name in names]
    assert [(one.outcome, one.rate_hz, one.reason) for one in found] == 20 * [("completed", 10, "")]
    for tap in run.taps.values():  # each was measured again
        asked = [one.text for one in takewhile(lambda one: not one.is_write, tap.heard)]
        assert asked.count("RSER") == TIMED_READS // 2


def test_fit_never_takes_more_than_the_recipe_asks() -> None:
    run = prepare(recipe=RECIPE + "\n[sampling]\nrate_hz = 2\n", duration_s=5, rate="fit").go()
    assert run.facts.period_s == 0.5


def test_max_asks_without_pause() -> None:
    run = prepare(line_text("noise_c = 2.0", "ports = [1]"), duration_s=60, rate="max").go()
    ticks = run.memory.column("tick")
    assert ticks == list(range(len(ticks)))
    assert set(run.memory.column("late_us")) == {None}
    asked = [one.at for one in run.heard if one.at > run.t0 + 2]
    busy = len(asked) * (0.0140625 + 0.001) / (asked[-1] - asked[0])
    assert busy > 0.99
    assert {"alarm_high", "setpoint_c", "delay_s"} <= set(run.facts.due["1"])
    assert run.facts.worst_slow_periods <= SLOW_CEILING
    assert_account_holds(run)


@pytest.mark.parametrize("rate", [0.2, 0.3, 1])
def test_a_slow_signal_comes_once_a_row_at_most(rate: float) -> None:
    """At 0.2 Hz the flags are due every 2 s, and there is a row every 5 s."""
    run = prepare(duration_s=120, rate=rate).go()
    assert run.facts.outcome == "completed"
    assert run.facts.due["1"]["alarm_high"] <= len(run.memory.column("tick"))
    assert_account_holds(run)


def test_a_rate_whose_rows_are_too_rare_for_a_ceiling_is_refused_before_any_write() -> None:
    """The flags are due every 2 s and must never be older than 6 s; at 0.1 Hz there is a row every
    10 s.
    """
    run = prepare(duration_s=120, rate=0.1).go()
    assert run.facts.outcome == "refused"
    assert "the lowest rate is 0.167 Hz" in run.facts.reason
    assert run.station.log.writes == []


# -- late ticks ------------------------------------------------------------------------------------


def test_a_late_tick_is_no_burst_and_skipped_ticks_have_rows() -> None:
    """The driver returns 1.25 s late, as on a busy host."""
    run = prepare(duration_s=20)
    run.at(5, lambda: run.driver.clock.advance_to(run.driver.clock.monotonic() + 1.25))
    run.go()
    skipped = [
        row[COLUMN["tick"]] for row in run.memory.samples if row[COLUMN["quality"]] == "skipped"
    ]
    assert 20 <= len(skipped) <= 26  # two ports
    starts = sorted({one.at for one in run.heard if one.text == "RTT1" and one.at > run.t0 + 6})
    assert min(after - before for before, after in pairwise(starts)) > 0.085
    assert_account_holds(run)


def test_a_host_that_stood_still_leaves_an_event_and_a_count() -> None:
    run = prepare(duration_s=5000)
    run.at(5, lambda: run.driver.clock.advance_to(run.driver.clock.monotonic() + 3600))
    run.at(3610, lambda: run.driver.end("SIGINT"))
    run.go()
    (event,) = run.memory.of_kind("host.suspended")
    assert event.severity == "error"
    assert run.facts.skipped == pytest.approx(36_000, abs=3)
    assert len(run.memory.samples) < 300
    assert_account_holds(run)


def test_a_host_that_stood_still_over_the_end_leaves_no_tick_behind_it() -> None:
    run = prepare(duration_s=60)
    run.at(5, lambda: run.driver.clock.advance_to(run.driver.clock.monotonic() + 3600))
    run.go()
    assert run.facts.skipped == pytest.approx(560, abs=15)
    assert_account_holds(run)


# -- side by side ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "trouble",
    [
        '[[station.sim.fault]]\nkind = "silence"\nat_s = 5\n',
        '[[station.sim.fault]]\nkind = "late"\nat_s = 5\nby_s = 2.0\n',
        '[[station.sim.fault]]\nkind = "dropout"\nat_s = 5\nfor_s = 10\n',
        '[[station.sim.fault]]\nkind = "noise"\nat_s = 5\nbytes_count = 200\n',
    ],
    ids=["silent", "hung", "unplugged", "babbling"],
)
def test_a_station_in_trouble_moves_no_other(trouble: str) -> None:
    """I6: the lateness of the others is the same as without the fault."""
    calm = prepare(two_stations("seed = 1"), duration_s=30).go()
    troubled = prepare(two_stations("seed = 1\n" + trouble), duration_s=30).go()
    assert (
        troubled.facts.outages
        + sum(quality != "ok" for quality in troubled.memory.column("quality"))
        > 0
    )
    rows = [
        [row for row in run.memory.samples if row[COLUMN["station"]] == "dde-2"]
        for run in (calm, troubled)
    ]
    assert rows[0] == rows[1]


def test_one_hung_station_of_eight() -> None:
    stations = [
        line_text().split("[[station]]")[1].replace("dde-1", f"dde-{number}")
        for number in range(1, 9)
    ]
    stations[3] += '[[station.sim.fault]]\nkind = "late"\nat_s = 5\nby_s = 2.0\n'
    run = prepare(
        '[line]\nname = "eight"\n' + "".join(f"[[station]]{text}" for text in stations),
        duration_s=20,
    ).go()
    late: dict[object, list[int]] = {}
    for row in run.memory.samples:
        if isinstance(row[COLUMN["late_us"]], int):
            late.setdefault((row[COLUMN["station"]], row[COLUMN["port"]]), []).append(
                row[COLUMN["late_us"]]
            )  # type: ignore[arg-type]
    others = [
        values for (station, port), values in late.items() if station != "dde-4" and port == 1
    ]  # type: ignore[misc]
    assert len(others) == 7
    assert all(values == others[0] for values in others)


@pytest.mark.parametrize("rate", [None, "max"])
def test_a_station_that_knows_no_signal_ends_the_run(rate: str | None) -> None:
    """Without a pause such a run would never wait, and fill the memory with empty rows."""
    run = prepare(duration_s=5, rate=rate)
    ask = run.station.device.answer

    def answer(header: str, text: str, now: float) -> tuple[str, str] | None:
        is_sampling = run.facts.first_tick is not None and run.facts.outcome == "running"
        is_signal = header == "R" and len(text) == 3 and text[:2] in ("TT", "PP", "PS")
        return ("N", f"{text}00004") if is_sampling and is_signal else ask(header, text, now)

    run.station.device.answer = answer  # type: ignore[method-assign]
    run.go()
    assert run.facts.outcome == "refused"
    assert "none of the signals" in run.facts.reason
    assert len(run.memory.samples) == 2  # a row for each port
    assert set(run.facts.safe_state.values()) == {"verified"}


@pytest.mark.parametrize(
    ("family", "fits"),
    [("omega", False), ("dde", True)],
    ids=["the manual prints that it varies", "it does not"],
)
def test_a_rate_is_held_against_the_longest_answer_where_answers_vary(
    family: str, fits: bool
) -> None:
    """Manual 003, 11.1: 0 to 250 ms. If one answer in twelve is slow at the start, so is one in
    twelve in the run.
    """
    recipe = (
        RECIPE
        if family == "dde"
        else '[recipe]\nname = "test"\nrevision = 1\nfamilies = ["omega"]\n'
    )
    line = line_text("", "ports = [1]" if family == "dde" else "").replace("dde", family)
    (context,) = prepare(line, recipe, rate=3).contexts.values()
    context.ports[1] = PortState(1, 2)
    context.facts.turnaround_us = {"median": 5_000.0, "p99": 250_000.0, "n": 12}
    if fits:
        assert context.choose_pace().period_s == pytest.approx(1 / 3)
        return
    with pytest.raises(StartRefused, match=r"250\.00 ms response time"):
        context.choose_pace()


def test_a_line_on_which_most_questions_are_lost_is_not_run_on() -> None:
    lost = "".join(
        f'\n[[station.sim.fault]]\nkind = "silence"\ncommand = "{name}"\n'
        for name in ("station_error", "tip_temperature")
    )
    run = prepare(line_text(lost, "ports = [1]"), duration_s=5).go()
    assert run.facts.outcome == "refused"
    assert (
        "only 0 of 12 questions were answered; the link is too unreliable to start"
        in run.facts.reason
    )
    assert run.writes == []
