"""Campaign 4, the stations: what stations, and the people around them, do to a run. One row per
case, with its F-number from docs/reference/faults.md.

``pytest -n0 -m campaign tests/faults/test_station_campaign.py`` mixes all cases at random on lines
of stations (STATIONS_RUNS runs from number STATIONS_FIRST on). The stations' own memory decides:
the invariants of `invariants.py`, the recipe's list of writes, and no write to a station that comes
back until its tools are made safe.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

import pytest

from support.campaigns.slices import first
from support.oracles.account import reasons_in
from support.oracles.invariants import violations_of
from support.oracles.sane import assert_memory_is_bounded, must_end_within
from support.product import COLUMN, SIM_WORKING, VirtualStation
from support.virtual.lines import fault, line, say
from support.virtual.virtual_run import RECIPE, VirtualRun, prepare

GOING_ON = RECIPE + 'on_difference = "continue"\n\n[sampling]\ncounters_every_s = 10\n'
STOPPING = RECIPE + "\n[sampling]\ncounters_every_s = 10\n"
SECONDS = 40.0
RUNS, FIRST = (
    int(os.environ.get("STATIONS_RUNS", "2000")),
    int(os.environ.get("STATIONS_FIRST", "0")),
)
Act = Callable[[VirtualRun], object]


def away(at_s: float = 10.0, for_s: float = 3.0) -> str:
    """Unplug the cable."""
    return fault("dropout", at_s=at_s, for_s=for_s)


def hours(number: int) -> str:
    """Set the age of a station."""
    return f"counters = {{plugged_hours = {number}}}\n"


# -- actions of people and stations ----------------------------------------------------------------


def station(run: VirtualRun, number: int = 1) -> VirtualStation:
    found = run.stations[f"dde-{number}"]
    assert isinstance(found, VirtualStation)
    return found


def swap_cables(run: VirtualRun) -> None:
    """Exchange the stations of two cables."""
    one, two = run.taps["dde-1"], run.taps["dde-2"]
    one._station, two._station = two._station, one._station


def robot_mode(on: bool) -> Act:
    return lambda run: setattr(station(run).device.identity, "robot_mode", on)


def setting(name: str, value: object) -> Act:
    """Change a setting of port 1 at the panel."""
    return lambda run: setattr(station(run).plant.ports[1].settings, name, value)


def order(state: int, extractor: bool) -> Act:
    return lambda run: station(run).plant.ports[1].order(state, extractor)


def latch(run: VirtualRun) -> None:
    station(run).plant.ports[1].high.latched = True


def count_from(name: str, value: float) -> Act:
    """Set a counter to another value from now on."""

    def change(run: VirtualRun) -> None:
        plant = station(run).plant
        plant.start_counts = {**plant.start_counts, name: value}

    return change


# -- the table -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """The case, what must and must not be reported of `dde-1`, and how it ends."""

    phrase: str
    number: int
    line: str
    told: tuple[str, ...]
    not_told: tuple[str, ...] = ()
    acts: tuple[tuple[float, Act], ...] = ()
    outcome: str = "completed"
    recipe: str = GOING_ON
    also: Callable[[VirtualRun], None] = field(default=lambda run: None)
    unsafe: int = 0  # tools that cannot be made safe, and are reported

    def __str__(self) -> str:
        return f"{self.number}: {self.phrase}"


def _missing(run: VirtualRun, why: str) -> int:
    own = [
        row
        for row in run.memory.samples
        if row[COLUMN["station"]] == "dde-1" and row[COLUMN["port"]] == 1
    ]
    return sum(reasons_in(row).get("temperature_c") == why for row in own)


def _rows_of_the_outage(run: VirtualRun) -> None:
    assert 25 <= _missing(run, "disconnected") <= 50


def _rows_without_robot_mode(run: VirtualRun) -> None:
    assert 25 <= _missing(run, "robot_off") <= 50


def _no_foreign_hours(run: VirtualRun) -> None:
    """No counter of the other station is under this one's name, nor the reverse."""
    for one in run.memory.counters:
        if one.counter == "plugged_h" and one.value is not None:
            assert one.value == {"dde-1": 100, "dde-2": 5000}[one.station]


def _flags_are_unknown(run: VirtualRun) -> None:
    """No row says "no alarm" between the readings before and after the lost answer."""
    (event,) = run.memory.of_kind("alarm.unknown")
    rows = [
        row
        for row in run.memory.samples
        if row[COLUMN["port"]] == 1 and "alarm_high" in reasons_in(row)
    ]
    assert [reasons_in(row)["alarm_high"] for row in rows] == ["timeout"]
    assert event.earliest is not None
    assert event.time - event.earliest > 1.5e6


def _counted(*values: float | None, counter: str = "sleep_cycles") -> Callable[[VirtualRun], None]:
    """Return the recorded values of a counter of port 1, in order: as the station shows them, none
    in between, none invented.
    """

    def check(run: VirtualRun) -> None:
        rows = [
            one.value
            for one in run.memory.counters
            if (one.station, one.port, one.counter) == ("dde-1", 1, counter)
        ]
        assert list(dict.fromkeys(rows)) == list(values)

    return check


CYCLES = "counters = {sleep_cycles = 100}\n"
NOT_SEEN_TWICE = ("identity.changed", "setting.changed")
TABLE = [
    Row(
        "unplugged and back",
        15,
        line(away()),
        ("link.lost", "link.back"),
        NOT_SEEN_TWICE,
        also=_rows_of_the_outage,
    ),
    Row(
        "replugged, and another unit answers",
        16,
        line(hours(100) + away()),
        ("link.lost", "identity.changed"),
        ("link.back",),
        acts=((11, count_from("plugged_hours", 40)),),
        outcome="gone",
        unsafe=2,
    ),
    Row(
        "two cables swapped",
        17,
        line(hours(100) + away(), hours(5000) + away()),
        ("link.lost", "identity.changed"),
        ("link.back",),
        acts=((11, swap_cables),),
        outcome="gone",
        also=_no_foreign_hours,
        unsafe=4,
    ),
    Row(
        "two cables swapped, and put right",
        17,
        line(hours(100) + away(), hours(5000) + away()),
        ("link.lost", "identity.changed", "link.back"),
        acts=((11, swap_cables), (20, swap_cables)),
        also=_no_foreign_hours,
    ),
    Row(
        "restart in mid-run",
        13,
        line(fault("restart", at_s=10, for_s=3)),
        ("link.lost", "link.back", "setting.changed"),
    ),
    Row(
        "restart in mid-run, and the recipe stops on it",
        13,
        line(fault("restart", at_s=10, for_s=3)),
        ("link.lost", "link.back", "setting.changed"),
        outcome="stopped",
        recipe=STOPPING,
    ),
    Row(
        "restart so short that no answer is missed",
        13,
        line(fault("restart", at_s=10.05, for_s=0.01)),
        ("setting.changed",),
        ("link.lost",),
    ),
    Row(
        "Robot mode switched off and on",
        12,
        line(""),
        ("robot.off", "robot.on"),
        NOT_SEEN_TWICE,
        acts=((10, robot_mode(False)), (13, robot_mode(True))),
        also=_rows_without_robot_mode,
    ),
    Row(
        "Robot mode switched off, a setting changed, and on",
        12,
        line(""),
        ("robot.off", "robot.on", "setting.changed"),
        acts=(
            (10, robot_mode(False)),
            (11, setting("selected_temperature", 300)),
            (13, robot_mode(True)),
        ),
        outcome="stopped",
        recipe=STOPPING,
    ),
    Row(
        "tool changed",
        14,
        line(fault("tool", port=1, code=3, at_s=10)),
        ("tool.changed",),
        ("setting.changed",),
    ),
    Row(
        "tool pulled out and put back",
        14,
        line(fault("tool", port=1, code=0, at_s=10, for_s=5)),
        ("tool.changed",),
    ),
    Row(
        "setting changed at the panel",
        14,
        line(""),
        ("setting.changed",),
        acts=((10, setting("selected_temperature", 300)),),
        outcome="stopped",
        recipe=STOPPING,
    ),
    Row(
        "limit changed at the panel",
        14,
        line(""),
        ("setting.changed",),
        acts=((10, setting("alarm_high_limit", 400)),),
    ),
    Row(
        "tool put to stand at the panel",
        14,
        line(""),
        ("setting.changed",),
        acts=((10, order(1, False)),),
    ),
    Row(
        "alarm flag raised and gone between two reads",
        40,
        line("joints_per_minute = 0\n" + fault("overheat", port=1, at_s=20.2, for_s=1.2, by_c=30)),
        ("alarm.high", "alarm.high.ended"),
        ("alarm.unknown",),
    ),
    Row(
        "alarm flag out of nothing",
        40,
        line("joints_per_minute = 0\n"),
        ("alarm.unconfirmed",),
        ("alarm.high",),
        ((20.5, latch),),
    ),
    Row(
        "the answer to the alarm flags lost",
        39,
        line(
            "joints_per_minute = 0\n"
            + fault("silence", command="alarm_flags", port=1, at_s=20, for_s=2.3)
            + fault("overheat", port=1, at_s=18.5, for_s=1.2, by_c=30)
        ),
        ("alarm.unknown",),
        also=_flags_are_unknown,
    ),
    Row(
        "a counter jumps",
        38,
        line(CYCLES),
        (),
        NOT_SEEN_TWICE,
        ((15, count_from("sleep_cycles", 5000)),),
        also=_counted(100, 5000),
    ),
    Row(
        "a counter falls",
        38,
        line(CYCLES),
        (),
        NOT_SEEN_TWICE,
        ((15, count_from("sleep_cycles", 7)),),
        also=_counted(100, 7),
    ),
    Row(
        # another unit may be on its cable, and nothing shows it
        "the hours that it is known by fall",
        17,
        line(hours(100)),
        ("link.lost", "identity.changed"),
        ("setting.changed",),
        ((15, count_from("plugged_hours", 7)),),
        also=_counted(100, None, counter="plugged_h"),
        outcome="gone",
        unsafe=2,
    ),
    Row(
        "a counter rolls over",
        38,
        line(hours(99_999.995)),
        (),
        NOT_SEEN_TWICE,
        also=_counted(99_999, 0, counter="plugged_h"),
    ),
    Row(
        "a write that is not taken",
        36,
        line(fault("nak", command="alarm_high_limit", only="write", code=3)),
        (),
        outcome="refused",
        unsafe=0,
    ),
    Row(
        "a sensor that cannot be",
        37,
        line("joints_per_minute = 0\n"),
        ("read.implausible",),
        acts=((10, lambda run: setattr(station(run).plant.ports[1], "stuck_c", 99_999)),),
    ),
    Row(
        "a tool of which nothing can be asked",
        37,
        line(""),
        ("tool.changed", "tool.unknown", "safety.safe_state"),
        ("read.format",),
        acts=((9, lambda run: say(run, "CT1", "00020", 10, times=1000)),),
    ),
    Row(
        "one hangs",
        18,
        line(fault("silence", at_s=10), ""),
        ("link.lost",),
        ("identity.changed",),
        outcome="gone",
        unsafe=2,
    ),
]


def prepared(row: Row) -> VirtualRun:
    run = prepare(row.line, row.recipe, duration_s=SECONDS)
    for at_s, act in row.acts:
        run.at(at_s, lambda act=act: act(run))  # type: ignore[misc]  # it is bound here
    must_end_within(run, 10 * SECONDS)
    return run


def assert_it_holds(run: VirtualRun) -> None:
    """In every case: the invariants, including the recipe's list of writes."""
    assert violations_of(run) == []


def assert_tools_rest_or_are_told(run: VirtualRun) -> None:
    for name, context in run.contexts.items():
        for number in context.facts.touched:
            port = station(run, int(name[-1])).plant.ports[number]
            rests = (
                port.tool == 0
                or port.doing.state != SIM_WORKING
                or (port.doing.extractor and port.character.extractor_cools)
            )
            told = any(f"port {number}:" in text for text in context.facts.unsafe)
            assert rests or told, (name, number)


@pytest.mark.parametrize("row", TABLE, ids=str)
def test_what_happens_to_a_station(row: Row) -> None:
    run = prepared(row).go()
    kinds = [event.kind for event in run.memory.events if event.station == "dde-1"]
    assert run.facts.outcome == row.outcome, run.facts.reason
    assert [kind for kind in row.told if kind not in kinds] == []
    assert [kind for kind in row.not_told if kind in kinds] == []
    assert sum(len(context.facts.unsafe) for context in run.contexts.values()) == row.unsafe
    row.also(run)
    assert_it_holds(run)
    assert_tools_rest_or_are_told(run)


@pytest.mark.parametrize(
    "row", [row for row in TABLE if row.number in (12, 13, 15, 16, 17)], ids=str
)
def test_nothing_is_written_to_what_comes_back_until_it_is_made_safe(row: Row) -> None:
    """Nothing heats by itself (docs/reference/faults.md, S-4): after the start there are only
    orders to stand.
    """
    run = prepared(row).go()
    after = [
        one.text
        for tap in run.taps.values()
        for one in tap.heard
        if one.is_write and one.at > run.t0 + 9
    ]
    assert [text for text in after if text not in ("WPS100001", "WPS200001")] == []


def test_the_table_has_every_phrase_of_the_issue() -> None:
    said = " ".join(row.phrase for row in TABLE)
    for phrase in (
        "unplugged",
        "swapped",
        "restart in mid-run",
        "Robot mode switched off and on",
        "tool changed",
        "at the panel",
    ):
        assert phrase in said
    for phrase in (
        "raised and gone between two reads",
        "alarm flags lost",
        "jumps",
        "falls",
        "rolls over",
        "hangs",
    ):
        assert phrase in said


# -- all of it at random ---------------------------------------------------------------------------


def _random_fault(random: Random) -> str:
    kind = random.choice(
        ["dropout", "restart", "tool", "overheat", "stuck", "silence", "late", "nak"]
    )
    keys: dict[str, object] = {
        "at_s": round(random.uniform(0, SECONDS), 2),
        "for_s": round(random.uniform(0.01, 12), 2),
    }
    keys |= {
        "tool": {"code": random.choice([0, 1, 3])},
        "nak": {"code": random.choice([3, 4, 5, 6, 99999])},
    }.get(kind, {})
    keys |= {"late": {"by_s": round(random.uniform(0.02, 3), 3)}}.get(kind, {})
    return fault(kind, **keys)


def _random_act(random: Random, run: VirtualRun) -> Act:
    acts: list[Act] = [
        robot_mode(False),
        robot_mode(True),
        setting("selected_temperature", 5 * random.randint(40, 80)),
        setting("alarm_high_limit", 400),
        order(random.choice([0, 1]), random.random() < 0.3),
        latch,
        count_from("plugged_hours", random.choice([0, 7, 150, 5000, 99_999.99])),
        count_from("sleep_cycles", random.choice([0, 7, 99_999])),
    ]
    return random.choice([*acts, swap_cables] if len(run.taps) > 1 else acts)


def mixed(number: int) -> VirtualRun:
    """A run of one to three stations to which this number does many things."""
    random = Random(number)
    sims = [
        hours(random.choice([3, 100, 5000]))
        + "".join(_random_fault(random) for _ in range(random.randint(0, 4)))
        for _ in range(3)
    ]
    recipe = random.choice([GOING_ON, GOING_ON, STOPPING])
    run = prepare(
        line(*sims[: random.randint(1, 3)]),
        recipe,
        duration_s=SECONDS,
        rate=random.choice([None, 2, "fit"]),
    )
    for _ in range(random.randint(0, 6)):
        act = _random_act(random, run)
        run.at(random.uniform(0, SECONDS), lambda act=act: act(run))  # type: ignore[misc]  # it is bound here
    if random.random() < 0.2:
        run.at(random.uniform(0, SECONDS), lambda: run.driver.end("SIGTERM"))
    must_end_within(run, 10 * SECONDS)
    return run.go()


def assert_mixed(number: int) -> VirtualRun:
    run = mixed(number)
    assert [
        context.facts.reason
        for context in run.contexts.values()
        if context.facts.outcome == "failed"
    ] == [], number
    try:
        assert_it_holds(run)
    except AssertionError as error:
        raise AssertionError(f"run {number}: {error}") from error
    return run


@pytest.mark.parametrize("number", first(4, range(20)))
def test_all_of_it_at_random(number: int) -> None:
    assert_mixed(number)


@pytest.mark.campaign
@pytest.mark.timeout(6 * 3600)
def test_all_of_it_at_random_for_long(counted: Callable[..., None]) -> None:
    lost, unsafe = 0, 0
    for number in range(FIRST, FIRST + RUNS):
        run = assert_mixed(number)
        lost += sum(context.facts.outages for context in run.contexts.values())
        unsafe += sum(len(context.facts.unsafe) for context in run.contexts.values())
        assert_memory_is_bounded()
    counted(runs=RUNS, outages=lost, rows_lost=0, wrong=0, hot_and_told=unsafe, hot_and_untold=0)


@pytest.mark.parametrize("rate", [10, 0.2])
def test_cables_swapped_so_quickly_that_no_answer_is_lost(rate: float) -> None:
    """F-17: only the plugged hours can show it, and do: from 100 to 5000 within a minute."""
    run = prepare(line(hours(100), hours(5000)), GOING_ON, duration_s=120, rate=rate)
    run.at(22.52, lambda: swap_cables(run))
    run.go()
    assert "identity.changed" in [event.kind for event in run.memory.events]
