"""A recorded run served as virtual stations and recorded again, by sessions that do not know it:
the decoded tables are equal.

On a virtual clock, where the host's delay is a number: each answer comes up to that much before or
after its time. A real host has some tenths of a millisecond, and a replay at several times the
speed has that many times more. What is compared, and what may differ:

- settings, counters, kinds of events and the tools' safe state: all the same; at ten times the
  speed, events of single slow readings (alarm flags, failed readings) are left out, because the
  last one may come after the end;
- samples: as many rows; each row has the same fast signals and quality, but for the share
  `MAY_DIFFER` if answers were corrupt, late or missing, because a lost slow reading takes the time
  of the fast ones after it;
- slow signals: the same readings in the same order, in any rows; the last one may come after the
  end. At ten times the speed they are read at other ticks, and a value between two readings is left
  out; none is new;
- times, lateness and scan times: not compared.

Which readings meet the trouble depends on the moment at which it begins and on the host: on this
full link the share can be twice the usual. So trouble begins at several moments and is served by
several hosts; what may differ is judged by its median, all else each time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import pytest

from jbclog.core.rows import COLUMN
from jbclog.sim.device import StationLog
from jbclog.sim.virtual import Reply, VirtualStation
from support.virtual.captured_run import kept, recorded_again
from support.virtual.virtual_run import RECIPE, Memory, VirtualRun, line_text

FAST = ("temperature_c", "power_permille", "status", "cooling", "desoldering", "quality")
SLOW = (
    "set_c",
    "tool",
    "port_error",
    "station_error",
    "alarm_high",
    "alarm_low",
    "transformer_c",
    "transistor_c",
)
HOST_S = 0.0003
MAY_DIFFER = {1: 0.02, 3: 0.1, 10: 0.15}
MAY_BE_LEFT_OUT = 1
SPEEDS = (1, 3, 10)
FAULT = "[[station.sim.fault]]\nkind = "
SECONDS = 12.0
Recorded = Callable[..., tuple[Path, Memory]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A run by its name, its line and more, recorded once for all speeds at which it is served; its
    folder, and what it told.
    """
    home = tmp_path_factory.mktemp("served")

    @cache
    def made(name: str, line: str, **more: Any) -> tuple[Path, Memory]:
        return home / name, kept(home / name, line, duration_s=SECONDS, **more)

    return made


def cells(memory: Memory, station: str, column: str) -> list[object]:
    return [row[COLUMN[column]] for row in memory.samples if row[COLUMN["station"]] == station]


class Difference(NamedTuple):
    """What two runs may differ in: the share of rows with another fast signal, and the number of
    values of a slow signal that were left out; the greatest of each.
    """

    share: float
    left_out: int


def assert_same(first: Memory, again: Memory, speed: int, may_differ: float = 0.0) -> None:
    """The tables are the same, as the docstring of this file defines it."""
    found = difference(first, again, speed)
    assert found.share <= may_differ
    assert found.left_out <= MAY_BE_LEFT_OUT


def difference(first: Memory, again: Memory, speed: int) -> Difference:
    """What differs; asserts that all else is the same."""
    shares, left_out = [0.0], [0]
    assert again.stations.keys() == first.stations.keys()
    for name, facts in first.stations.items():
        assert (again.stations[name].outcome, again.stations[name].safe_state) == (
            facts.outcome,
            facts.safe_state,
        )
        assert again.stations[name].period_s == pytest.approx(facts.period_s)
        assert settings(again, name) == settings(first, name)
        assert counters(again, name) == counters(first, name)
        assert kinds(again, name, speed) == kinds(first, name, speed)
        for column in FAST:
            shares.append(share_of_others(cells(first, name, column), cells(again, name, column)))
        for column in SLOW:
            ours, theirs = cells(first, name, column), cells(again, name, column)
            if speed < 10:
                assert_same_order(ours, theirs)
            assert {*theirs} <= {*ours, None}, (name, column)
            left_out.append(len({*ours} - {*theirs, None}))
    return Difference(max(shares), max(left_out))


def settings(memory: Memory, name: str) -> list[tuple[object, ...]]:
    return [row[1:] for row in memory.settings if row.station == name]


def counters(memory: Memory, name: str) -> list[tuple[object, ...]]:
    return [row[1:] for row in memory.counters if row.station == name]


def kinds(memory: Memory, name: str, speed: int) -> list[str]:
    left_out = () if speed < 10 else ("alarm.", "read.")
    return sorted(
        event.kind
        for event in memory.events
        if event.station == name and not event.kind.startswith(left_out)
    )


def share_of_others(ours: Sequence[object], theirs: Sequence[object]) -> float:
    assert len(ours) == len(theirs)
    return sum(mine != other for mine, other in zip(ours, theirs, strict=True)) / len(ours)


def assert_same_order(ours: Sequence[object], theirs: Sequence[object]) -> None:
    """The values change in the same order; the last change may be missing."""
    mine, others = changes(ours), changes(theirs)
    assert abs(len(mine) - len(others)) <= 1
    assert mine[: len(others)] == others[: len(mine)]


def changes(values: Sequence[object]) -> list[object]:
    found: list[object] = []
    for value in values:
        if value is not None and found[-1:] != [value]:
            found.append(value)
    return found


# -- several stations, each with a period of its own -----------------------------------------------

SECOND = """
[[station]]
name = "dde-2"
url = "dde-2"
family = "dde"
baudrate = 9600
ports = [1, 2]
[station.sim]
noise_c = 0.5
turnaround_ms = 3.0
[[station]]
name = "hde-1"
url = "hde-1"
family = "hde"
ports = [1]
[station.sim]
noise_c = 0.5
turnaround_ms = 20.0
"""


@pytest.mark.parametrize("speed", SPEEDS)
def test_stations_with_periods_of_their_own(recorded: Recorded, speed: int) -> None:
    folder, first = recorded("periods", line_text("noise_c = 0.5") + SECOND, rate="fit")
    assert len({facts.period_s for facts in first.stations.values()}) == 3
    again, stations = recorded_again(folder, HOST_S * speed)
    assert_same(first, again, speed)
    assert all(station.strange == 0 for station in stations.values())


# -- trouble ---------------------------------------------------------------------------------------

TROUBLE = {
    "late": FAULT + '"late"\nby_s = 0.3\nat_s = 3.{tenths}\nevery = 31',
    "lost": FAULT + '"silence"\nat_s = 3.{tenths}\nevery = 23',
    "corrupt": FAULT + '"flip"\nbits = 1\nat_s = 3.{tenths}\nevery = 11',
    "an outage": FAULT + '"dropout"\nat_s = 6.{tenths}\nfor_s = 2.5',
    "all at once": "\n".join(
        (
            FAULT + '"late"\nby_s = 0.2\nat_s = 3.{tenths}\nevery = 41',
            FAULT + '"silence"\nat_s = 3.{tenths}\nevery = 37',
            FAULT + '"flip"\nbits = 1\nat_s = 3.{tenths}\nevery = 17',
        )
    ),
}
MOMENTS = (0, 2, 4)  # tenths of a second later
HOSTS = (1, 2, 3)


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("trouble", TROUBLE)
def test_trouble(recorded: Recorded, trouble: str, speed: int) -> None:
    found = []
    for tenths, host in product(MOMENTS, HOSTS):
        line = line_text("noise_c = 0.5\n" + TROUBLE[trouble].format(tenths=tenths))
        folder, first = recorded(f"{trouble} {tenths}", line)
        again, _ = recorded_again(folder, HOST_S * speed, seed=host)
        found.append(difference(first, again, speed))
    assert median(one.share for one in found) <= MAY_DIFFER[speed]
    assert median(one.left_out for one in found) <= MAY_BE_LEFT_OUT


class Twice:
    """A station that sends every seventh answer twice."""

    def __init__(self, station: VirtualStation) -> None:
        self._station = station
        self._count = 0

    @property
    def log(self) -> StationLog:
        return self._station.log

    def receive(self, data: bytes, now: float) -> list[Reply]:
        said = self._station.receive(data, now)
        self._count += 1
        return said + [
            Reply(reply.at + 0.004, reply.data) for reply in said if self._count % 7 == 0
        ]

    def is_unplugged(self, now: float) -> bool:
        return self._station.is_unplugged(now)


def say_twice(run: VirtualRun) -> None:
    run.taps["dde-1"]._station = Twice(run.station)  # type: ignore[assignment]


@pytest.mark.parametrize("speed", SPEEDS)
def test_answers_that_came_twice(recorded: Recorded, speed: int) -> None:
    folder, first = recorded("twice", line_text("noise_c = 0.5"), arrange=say_twice)
    assert sum(first.stations["dde-1"].strays.values()) > 10
    again, _ = recorded_again(folder, HOST_S * speed)
    assert_same(first, again, speed, MAY_DIFFER[speed])


# -- nothing is made up ----------------------------------------------------------------------------


GOES_ON = f'{RECIPE}on_difference = "continue"\n'


def turn_down(run: VirtualRun) -> None:
    """The operator selects another temperature at the station's panel."""
    run.at(6.0, lambda: setattr(run.station.plant.ports[1].settings, "selected_temperature", 300))


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_change_at_the_panel_is_found_once_and_no_other(recorded: Recorded, speed: int) -> None:
    line = line_text("noise_c = 0.5")
    folder, first = recorded("panel", line, arrange=turn_down, recipe=GOES_ON)
    (change,) = first.of_kind("setting.changed")
    again, _ = recorded_again(folder, HOST_S * speed)
    assert_same(first, again, speed)
    (found,) = again.of_kind("setting.changed")
    assert (found.raw, found.text) == (change.raw, change.text)


@pytest.mark.parametrize("longer_s", [0.5, 2.0])
def test_who_asks_longer_is_not_answered_from_behind_the_order_that_ended_the_run(
    tmp_path: Path, longer_s: float
) -> None:
    """The tool's state was read, then ordered to sleep. A further read gives the state before that
    order.
    """
    first = kept(tmp_path / "run", line_text("noise_c = 0.5"), duration_s=5.0)
    again, stations = recorded_again(tmp_path / "run", longer_s=longer_s)
    assert first.of_kind("setting.changed") == again.of_kind("setting.changed") == []
    assert again.stations["dde-1"].outcome == "completed"
    assert sum(stations["dde-1"].repeated.values()) > 0
    states = cells(again, "dde-1", "status")
    assert set(states) == {"working"}
    assert len(states) > len(cells(first, "dde-1", "status"))


def test_a_host_that_stands_still_costs_the_ticks_at_that_moment_and_none_after_them(
    tmp_path: Path,
) -> None:
    """A tick that comes late, or waits itself, gets the value of the time when it comes."""
    first = kept(
        tmp_path / "run", line_text("noise_c = 0.5", "ports = [1]"), duration_s=SECONDS, rate=10.0
    )
    again, stations = recorded_again(tmp_path / "run", HOST_S, stalls=(0.25, 0.13))
    ours, theirs = cells(first, "dde-1", "temperature_c"), cells(again, "dde-1", "temperature_c")
    late = [
        late_us > 20_000 or scan_us > 100_000
        for late_us, scan_us in zip(
            cells(again, "dde-1", "late_us"), cells(again, "dde-1", "scan_us"), strict=True
        )
        if isinstance(late_us, int) and isinstance(scan_us, int)
    ]
    assert len(ours) == len(theirs) == len(late)
    others = [
        place for place, pair in enumerate(zip(ours, theirs, strict=True)) if pair[0] != pair[1]
    ]
    assert others
    assert all(late[place] for place in others)
    assert stations["dde-1"].left_out > 0
    assert sum(stations["dde-1"].repeated.values()) > 0
