"""Starts of eight stations on bad serial lines: a lost frame refuses no run, and no value is wrong.

Each frame meets each of nine faults with the same probability (`lossy_wire`). At 1 % for each, 9 %
of all frames are disturbed, and no start may be refused. At 5 % for each, 45 % are disturbed; a
start may then fail, and must state at which setting or reading and after how many tries.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from random import Random

import pytest

from support.campaigns.awaited import HOW_OFTEN
from support.links.lossy_wire import ACCIDENTS, LossyWire
from support.oracles.sane import assert_memory_is_bounded, must_end_within
from support.product import (
    STAND,
    WORKING,
    SettingRow,
    StationFacts,
    StationTask,
    Steps,
    VirtualStation,
    text_of,
)
from support.virtual.virtual_run import RECIPE, VirtualRun, prepare

STATIONS = 8
FAMILIES = ("dde", "nae", "ucr", "hde")
HELD = "selected_temperature = 300, sleep_delay = 9, hibernation_delay = 60"
STATION = """
[[station]]
name = "s{number}"
url = "s{number}"
family = "{family}"
ports = [1]
[station.sim]
turnaround_ms = {turnaround_ms}
settings = {{{held}}}
"""
ASKED = {
    "sleep_delay": "5",
    "hibernation_delay": "30",
    "alarm_high_limit": "380",
    "alarm_high_delay": "0.50",
}
ASKED |= {"alarm_low_limit": "250", "alarm_low_delay": "2.00", "selected_temperature": "350"}
IN_STATION = (
    "selected_temperature",
    "alarm_high_limit",
    "alarm_low_limit",
    "alarm_high_delay",
    "alarm_low_delay",
)


def started(number: int, share: float) -> tuple[VirtualRun, list[LossyWire]]:
    """Run one start of eight stations, each on its own serial line, and a second of sampling."""
    wires: list[LossyWire] = []

    def behind_wire(
        order: StationTask, session: Steps[StationFacts], tap: object
    ) -> tuple[Steps[StationFacts], LossyWire]:
        wires.append(LossyWire(tap, Random(f"{number} {order.name}"), share))  # type: ignore[arg-type]  # it is a tap
        return session, wires[-1]

    random = Random(number)
    line = '[line]\nname = "bench"\n' + "".join(
        STATION.format(
            number=one,
            family=FAMILIES[one % 4],
            turnaround_ms=random.choice([0.5, 2.0, 8.0]),
            held=HELD,
        )
        for one in range(1, 1 + STATIONS)
    )
    run = prepare(line, RECIPE, duration_s=1.0, rate=2.0, pulled=behind_wire)
    must_end_within(run, 600)
    return run.go(), wires


def wrong_values(run: VirtualRun) -> Iterator[str]:
    """Yield each value that the record gives wrongly as held by a station, and each wrong value
    that was written to one.
    """
    for row in run.memory.settings:
        if row.outcome in ("confirmed", "unchanged") and row.setting != "status":
            yield from _wrong(run, row)
    for name, station in run.stations.items():
        assert isinstance(station, VirtualStation)
        for write in station.log.writes:
            allowed = {"status": [WORKING, STAND]}.get(write.name) or [ASKED[write.name]]
            if write.value not in allowed and text_of(write.value) not in allowed:  # type: ignore[arg-type]  # a value
                yield f"{name}: {write.name} was written with {write.value}"


def _wrong(run: VirtualRun, row: SettingRow) -> Iterator[str]:
    station = run.stations[row.station]
    assert isinstance(station, VirtualStation)
    port = station.plant.ports[row.port or 1]
    place = port.settings if row.setting in IN_STATION else port.tools[port.tool]
    held = text_of(getattr(place, row.setting))
    if not held == row.readback == row.requested == ASKED[row.setting]:
        yield (
            f"{row.station}: {row.setting} is {held} and is recorded as {row.readback}, asked was"
            f" {row.requested}"
        )


def is_working(run: VirtualRun, name: str) -> bool:
    """Whether the station was ordered to work, and its record has the order as confirmed."""
    station = run.stations[name]
    assert isinstance(station, VirtualStation)
    rows = [
        row.outcome
        for row in run.memory.settings
        if row.station == name and row.setting == "status"
    ]
    return rows[-1] == "confirmed" and station.log.written("status")[0].value == WORKING


def refused(run: VirtualRun) -> dict[str, str]:
    """Return the stations that did not start sampling, with the reason."""
    return {
        name: context.facts.reason
        for name, context in run.contexts.items()
        if context.facts.first_tick is None
    }


def failed(run: VirtualRun) -> dict[str, str]:
    """Return the stations of `refused` that failed themselves; the others were ready, and did not
    start because of these.
    """
    return {
        name: why
        for name, why in refused(run).items()
        if run.contexts[name].facts.outcome != "not_started"
    }


def tally(run: VirtualRun, wires: list[LossyWire]) -> Counter[str]:
    told = Counter[str](starts=1, stations=STATIONS, frames=sum(wire.frames for wire in wires))
    told["disturbed"] = sum(wire.did.total() for wire in wires)
    told["written_again"] = sum(
        context.facts.settings_repeated for context in run.contexts.values()
    )
    told["refused"], told["runs_refused"] = len(failed(run)), bool(refused(run))
    return told


def assert_start_holds(run: VirtualRun, number: int) -> None:
    assert list(wrong_values(run)) == [], number
    for context in run.contexts.values():
        again = [
            row
            for row in run.memory.settings
            if (row.station, row.outcome) == (context.name, "repeated")
        ]
        events = [
            event
            for event in run.memory.of_kind("setting.repeated")
            if event.station == context.name
        ]
        assert len(again) == len(events) == context.facts.settings_repeated


@pytest.mark.parametrize("number", range(4))
def test_no_start_is_refused_at_one_percent_of_each(number: int) -> None:
    run, wires = started(number, 0.01)
    assert refused(run) == {}
    assert_start_holds(run, number)
    assert all(is_working(run, name) for name in run.contexts)
    assert sum(wire.did.total() for wire in wires) > 20


@pytest.mark.parametrize("number", range(2))
def test_no_value_is_wrong_at_five_percent_of_each(number: int) -> None:
    run, wires = started(number, 0.05)
    assert_start_holds(run, number)
    for reason in failed(run).values():
        assert HOW_OFTEN.search(reason), reason
    assert set().union(*(wire.did for wire in wires)) == set(ACCIDENTS)


@pytest.mark.campaign
@pytest.mark.parametrize("block", range(20))
def test_two_hundred_starts_at_one_percent_of_each(
    block: int, counted: Callable[..., None]
) -> None:
    for number in range(100 + 10 * block, 110 + 10 * block):
        run, wires = started(number, 0.01)
        assert refused(run) == {}, number
        assert_start_holds(run, number)
        assert_memory_is_bounded()
        counted(**tally(run, wires), wrong_values=0)


@pytest.mark.campaign
@pytest.mark.parametrize("block", range(10))
def test_a_hundred_starts_at_five_percent_of_each(block: int, counted: Callable[..., None]) -> None:
    for number in range(1000 + 10 * block, 1010 + 10 * block):
        run, wires = started(number, 0.05)
        assert_start_holds(run, number)
        for reason in failed(run).values():
            assert HOW_OFTEN.search(reason), reason
        counted(
            **{f"at_5_percent_{name}": count for name, count in tally(run, wires).items()},
            at_5_percent_wrong_values=0,
        )
