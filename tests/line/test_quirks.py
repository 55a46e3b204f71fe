"""A station that deviates from the recommended form: the run records the same as without the
deviation, and reports it once.

Every quirk that a virtual station has is tried here, in a whole run, or against the client alone if
a run never sends the command. The table of decisions gives the row of each quirk.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import pytest

from support.product import (
    COLUMN,
    FAMILIES,
    SAMPLE_COLUMNS,
    SIGNAL_COLUMNS,
    TIMED_READ,
    LineFormat,
    Reopen,
    SimSpec,
    Station,
    StationError,
    StationSpec,
    Steps,
    VirtualClock,
    VirtualDriver,
    VirtualStation,
    change_address,
    contradictions,
    omega_quirks,
    restart,
    robot_quirks,
)
from support.product import do as do_request
from support.readers.texts import ROOT
from support.virtual.lines import hot_air
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

SECONDS = 14.0
CONTRADICTIONS = contradictions()
QUIRKS = robot_quirks()
HOT_C, HOLDING_W = 350.0, 9.81
FAMILIES_IN_RECIPE = re.compile("families = .*")

Act = Callable[[VirtualRun], None]


def _nothing(run: VirtualRun) -> None:
    return


def _port_error(run: VirtualRun) -> None:
    run.at(5, lambda: setattr(run.station.plant.ports[1], "error", 8))
    run.at(9, lambda: setattr(run.station.plant.ports[1], "error", 0))


def _feed(run: VirtualRun) -> None:
    run.at(6, lambda: run.station.plant.feeder.start(run.driver.clock.monotonic()))


@dataclass(frozen=True, eq=False)
class Case:
    """A run that shows a quirk: the family, the keys of line file and recipe, and an action during
    the run.

    `differs`: columns that keep the number as received, each with a function that makes both
    numbers comparable. `tells`: the driver can notice the quirk. `usually`: the recommended form is
    an anomaly as well.
    """

    family: str = "dde"
    sim: str = ""
    settings: str = ""
    recipe: str = ""
    act: Act = _nothing  # what happens meanwhile
    is_hot: bool = True
    tells: bool = True
    usually: bool = False
    differs: dict[str, Callable[[object], object]] = field(default_factory=dict)


OVERHEAT = '\n[[station.sim.fault]]\nkind = "overheat"\nport = 1\nat_s = 4\nfor_s = 4\nby_c = 40\n'
UNDEFINED = (
    '\n[[station.sim.fault]]\nkind = "nak"\ncode = 99999\ncommand = "tip_temperature"\n'
    "at_s = 4\nevery = 4\n"
)
RECIPE_OF_OMEGA = ROOT.joinpath("profiles/recipes/omega-point.toml").read_text(encoding="utf-8")
PLAIN = Case()
ALE = Case("ale", "counters = {dispensed_length = 100.0, dispensed_cycles = 42}")

IN_A_RUN: dict[str, Case] = {
    "minus_as_dot": Case(settings=", adjust = -12"),
    "software_in_ten_characters": PLAIN,
    "addresses_swapped": PLAIN,
    "transformer_padded_with_blank": PLAIN,
    "transformer_padded_with_zero": PLAIN,
    "transformer_wants_blank": PLAIN,
    "refusal_without_code": Case("hde"),
    "extractor_refused": Case("ucr", recipe='safe_state = "extractor"\n'),
    "sleep_delay_in_seconds": PLAIN,
    "delay_without_dot": PLAIN,
    "alarm_not_set_is_zero": PLAIN,
    "alarm_not_set_is_out_of_range": PLAIN,
    "alarm_flags_of_any_digit": Case(sim=OVERHEAT),
    "alarm_flags_stay": Case(sim=OVERHEAT, tells=False, differs={"alarm_high": lambda _: None}),
    "countdown_65535": PLAIN,
    "countdown_zero": PLAIN,
    "port_error_80000": Case(act=_port_error),
    "power_above_full": Case(
        is_hot=False, differs={"power_permille": lambda power: min(int(str(power)), 1000)}
    ),
    "six_letter_model": PLAIN,
    "model_cut_to_five": Case("ucr", usually=True),  # UCR245 has six letters
    "model_unpadded": PLAIN,
    "hex_with_0x": ALE,
    "hex_lower_case": ALE,
    "hex_of_eight": ALE,
    "dispensed_cycles_answers_acd": ALE,
    "no_data_orders": Case("ale", act=_feed),
    "status_acknowledged_with_value": PLAIN,
    "alarm_delay_answers_ald": PLAIN,
    "model_with_type": PLAIN,
    "undefined_error_255": Case(sim=UNDEFINED),
}
AT_THE_CLIENT = {
    "address_acknowledged_from_the_new_one",
    "address_acknowledged_without_any",
    "refuses_other_addresses",
    "silent_after_restart",
}


@cache
def run_of(case: Case, *quirks: str) -> VirtualRun:
    """The run of a case with these quirks, for all that only look at it."""
    sim = (
        f"joints_per_minute = 0\nquirks = {[*quirks]}\nsettings = {{status ="
        f' "working"{case.settings}}}\n{case.sim}'
    )
    line = line_text(sim).replace('family = "dde"', f'family = "{case.family}"')
    run = prepare(
        line,
        FAMILIES_IN_RECIPE.sub(f'families = ["{case.family}"]', RECIPE) + case.recipe,
        SECONDS,
        rate=3,
    )
    if case.is_hot:
        for port in run.station.plant.ports.values():
            port.tip.temperature_c, port.tip.integral_w = HOT_C, HOLDING_W
    case.act(run)
    return run.go()


def samples(run: VirtualRun, case: Case) -> list[tuple[object, ...]]:
    """Return the rows without their times, and with the columns of `differs` made comparable."""
    columns = [
        column
        for column in SAMPLE_COLUMNS
        if column in (*SIGNAL_COLUMNS, "port", "quality", "reasons")
    ]
    same: Callable[[object], object] = lambda value: value  # noqa: E731  # the rule for all other columns
    rules = [(COLUMN[column], case.differs.get(column, same)) for column in columns]
    return [
        tuple(None if row[place] is None else rule(row[place]) for place, rule in rules)
        for row in run.memory.samples
    ]


def settings(run: VirtualRun) -> list[tuple[object, ...]]:
    return [tuple(row)[1:] for row in run.memory.settings]


def counters(run: VirtualRun) -> list[tuple[object, ...]]:
    return [(row.station, row.port, row.counter, row.value, row.uom) for row in run.memory.counters]


def test_every_quirk_is_played() -> None:
    assert set(IN_A_RUN) | AT_THE_CLIENT == set(QUIRKS)
    assert set(IN_A_RUN) & AT_THE_CLIENT == set()
    assert set(omega_quirks()) == {"temperature_in_degrees", "in_range_is_optimal"}


def kinds(run: VirtualRun) -> list[tuple[str, int | None, int | None]]:
    return [
        (event.kind, event.port, event.code)
        for event in run.memory.events
        if event.kind != "protocol.anomaly"
    ]


@pytest.mark.parametrize("quirk", IN_A_RUN)
def test_a_run_records_the_same_with_a_quirk_as_without(quirk: str) -> None:
    case, number = IN_A_RUN[quirk], QUIRKS[quirk]
    usual, odd = run_of(case), run_of(case, quirk)
    assert (
        (odd.facts.outcome, odd.facts.reason)
        == (usual.facts.outcome, usual.facts.reason)
        == ("completed", "")
    )
    assert samples(odd, case) == samples(usual, case)
    assert settings(odd) == settings(usual)
    assert counters(odd) == counters(usual)
    assert kinds(odd) == kinds(usual)
    assert odd.facts.safe_state == usual.facts.safe_state
    assert odd.facts.due == usual.facts.due
    assert (number in usual.facts.anomalies) == case.usually
    assert (odd.facts.anomalies.get(number, 0) > 0) == case.tells


@pytest.mark.parametrize("quirk", [quirk for quirk, case in IN_A_RUN.items() if case.tells])
def test_a_quirk_is_one_event_that_says_what_was_met_and_how_it_is_read(quirk: str) -> None:
    number = QUIRKS[quirk]
    run = run_of(IN_A_RUN[quirk], quirk)
    (event,) = [event for event in run.memory.of_kind("protocol.anomaly") if event.code == number]
    row = CONTRADICTIONS[number]
    assert event.text.startswith(row.met)
    assert "First met: " in event.text
    assert event.raw
    assert event.severity == ("warning" if row.doubtful and not row.usual else "info")
    assert event.station == "dde-1"


def test_all_quirks_at_once_change_nothing_either() -> None:
    # one padding is enough
    all_that_go_together = [quirk for quirk in IN_A_RUN if quirk != "transformer_padded_with_zero"]
    usual, odd = run_of(ALE), run_of(ALE, *all_that_go_together)
    assert odd.facts.outcome == "completed", odd.facts.reason
    assert samples(odd, ALE) == samples(usual, ALE)
    assert settings(odd) == settings(usual)
    assert counters(odd) == counters(usual)
    assert odd.facts.safe_state == usual.facts.safe_state == {1: "verified"}
    assert {5, 6, 10, 11, 20, 22, 23, 25, 35, 36, 43, 53} <= set(odd.facts.anomalies)


def test_an_extractor_state_that_a_recipe_wants_and_the_station_refuses_stops_the_start() -> None:
    """Like any refused setting. As a safe state it is replaced by stand."""
    line = line_text('quirks = ["extractor_refused"]').replace('"dde"', '"ucr"')
    recipe = FAMILIES_IN_RECIPE.sub('families = ["ucr"]', RECIPE).replace(
        'status = "working"', 'status = "extractor"'
    )
    run = prepare(line.replace("quirks", 'settings = {status = "working"}\nquirks'), recipe, 3).go()
    assert run.facts.outcome == "refused"
    assert "the station refused it with N 00003" in run.facts.reason
    assert 19 in run.facts.anomalies


# -- what nobody can decide ------------------------------------------------------------------------


@pytest.mark.parametrize("quirk", [[], ["sleep_delay_in_seconds"]])
def test_the_unit_of_the_sleep_delay_shows_wherever_a_tool_is_told_to_stand(
    quirk: list[str],
) -> None:
    """At the end of every run, and at its start if the recipe orders the tools to stand."""
    line = line_text(f'quirks = {quirk}\nsettings = {{status = "working"}}')
    stands = prepare(line, RECIPE.replace('status = "working"', 'status = "stand"'), 2).go()
    works = prepare(line, RECIPE, 2).go()
    for run in (stands, works):
        told = [event for event in run.memory.of_kind("protocol.anomaly") if event.code == 20]
        assert [(event.severity, event.raw) for event in told] == [("warning", "00005")] * len(
            quirk
        )
    # two ports
    assert stands.facts.anomalies.get(20, 0) == works.facts.anomalies.get(20, 0) == 2 * len(quirk)


def test_the_air_flow_without_a_unit_is_marked_and_kept() -> None:
    run = hot_air("", duration_s=3).go()
    (event,) = [event for event in run.memory.of_kind("protocol.anomaly") if event.code == 33]
    assert event.severity == "info"
    # as it was before the recipe was applied; the settings have it, too
    assert event.raw == "00500"
    assert [row.written for row in run.memory.settings if row.setting == "selected_air_flow"] == [
        None,
        "600",
    ]


@pytest.mark.parametrize(("quirk", "raw"), [([], "3500"), (["temperature_in_degrees"], "350")])
def test_a_set_temperature_of_omega_is_marked_and_kept_in_tenths_or_not(
    quirk: list[str], raw: str
) -> None:
    """Nothing distinguishes the two units, so the event has both numbers; the run is refused,
    because the recipe requires another value.
    """
    recipe = RECIPE_OF_OMEGA
    line = line_text(f"quirks = {quirk}").replace('"dde"', '"omega"')
    run = prepare(line, recipe.replace("condition = 101", "condition = 399"), 3).go()
    assert run.facts.outcome == "refused"
    (event,) = run.memory.of_kind("protocol.anomaly")
    assert (event.code, event.severity) == (51, "info")
    assert f"condition 399: {raw} on the wire" in event.text
    assert event.raw is not None
    assert f"{int(raw):03X}" in event.raw


@pytest.mark.parametrize(("quirk", "rows_out"), [("", 10), ("in_range_is_optimal", 14)])
def test_that_f_has_two_meanings_is_marked_once(quirk: str, rows_out: int) -> None:
    """Nothing on the link distinguishes the two; with the second a joint is out from its start."""
    quirks = [quirk] if quirk else []
    line = line_text(f"joints_per_minute = 20\nquirks = {quirks}").replace('"dde"', '"omega"')
    run = prepare(line, RECIPE_OF_OMEGA, 30).go()
    events = [event for event in run.memory.of_kind("protocol.anomaly") if event.code == 55]
    assert [(event.severity, "alarm limits" in event.text) for event in events] == [("info", True)]
    assert [row[COLUMN["in_range"]] for row in run.memory.samples].count(False) == rows_out


# -- what a run never sends ------------------------------------------------------------------------


def station_of(family: str, *quirks: str) -> VirtualStation:
    spec = StationSpec(name="s", url="s", family=family, sim=SimSpec(quirks=quirks))
    return VirtualStation(spec, now=VirtualClock().monotonic())


def do(
    other: VirtualStation, ask: Callable[[Station], Steps[object]], address: int | None = 1
) -> tuple[Station, object]:
    """Return the client, and the value or the error of its request."""
    station, outcome = Station(LineFormat(), address), list[object]()

    async def steps() -> None:
        station.unasked(await do_request(Reopen()))
        try:
            outcome.append(await ask(station))
        except StationError as error:
            outcome.append(error)

    driver = VirtualDriver(VirtualClock())
    driver.add(steps(), other)
    driver.run()
    return station, outcome[0]


UCR = FAMILIES["ucr"].commands
NEW, NONE = "address_acknowledged_from_the_new_one", "address_acknowledged_without_any"


@pytest.mark.parametrize("quirk", [(), (NEW,), (NONE,)])
@pytest.mark.parametrize("new", [7, None])
def test_an_address_is_changed_however_that_is_acknowledged(
    quirk: tuple[str, ...], new: int | None
) -> None:
    other = station_of("ucr", *quirk)
    station, outcome = do(other, lambda client: change_address(client, UCR["address"], new))
    assert outcome is None
    assert station.address == other.device.identity.address == new
    assert [write.value for write in other.log.written("address")] == [new or 0]
    assert station.anomalies.counts[9] == len(quirk)
    assert [one.number for one in station.anomalies.take() if one.number == 9] == [9] * len(quirk)


def test_a_station_that_keeps_its_address_is_spoken_to_at_it() -> None:
    other = station_of("ucr")
    other.device.answer = lambda header, text, now: ("A", "SAD" if header == "W" else "SMNUCR245")  # type: ignore[method-assign]
    station, outcome = do(other, lambda client: change_address(client, UCR["address"], 7))
    assert "still answers at its old address (01)" in str(outcome)
    assert station.address == 1


def test_a_change_of_address_that_is_refused_changes_nothing() -> None:
    other = station_of("ucr")
    station, outcome = do(other, lambda client: change_address(client, UCR["address"], 100))
    assert isinstance(outcome, StationError)
    assert station.address == 1


@pytest.mark.parametrize("quirk", [(), ("silent_after_restart",)])
def test_a_restart_is_waited_for_whether_it_is_acknowledged_or_not(quirk: tuple[str, ...]) -> None:
    other = station_of("dde", *quirk)
    station, took = do(other, lambda client: restart(client, FAMILIES["dde"].commands["restart"]))
    assert isinstance(took, float)
    assert 3.0 < took < 10.0
    assert len(other.log.written("restart")) == 1
    assert station.anomalies.counts[40] == len(quirk)


def test_a_station_that_does_not_come_back_is_gone() -> None:
    other = station_of("dde")
    other.device.restart = lambda now, silent_s=0.0: setattr(
        other.device, "_silent_until", float("inf")
    )  # type: ignore[method-assign]
    _, outcome = do(other, lambda client: restart(client, FAMILIES["dde"].commands["restart"]))
    assert "no answer within 30 s" in str(outcome)


@pytest.mark.parametrize("quirk", [(), ("refuses_other_addresses",)])
@pytest.mark.parametrize("address", [2, None])
def test_nobody_is_found_under_another_address_whether_that_is_refused_or_not(
    quirk: tuple[str, ...], address: int | None
) -> None:
    station, outcome = do(
        station_of("dde", *quirk), lambda client: client.read(TIMED_READ), address
    )
    assert isinstance(outcome, StationError)
    assert station.exchanges >= 3


@pytest.mark.parametrize("quirk", [(), ("status_acknowledged_with_value",)])
def test_hot_air_acknowledges_a_status_with_or_without_its_value(quirk: tuple[str, ...]) -> None:
    commands = FAMILIES["jtse"].commands
    station, outcome = do(
        station_of("jtse", *quirk),
        lambda client: client.write(commands["status"], (0, 0, 0, 1, 0), 1),
    )
    assert outcome is None
    assert station.anomalies.counts[43] == len(quirk)
