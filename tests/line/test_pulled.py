"""A tool pulled out of its port at work: no reading of it is recorded as a temperature, and no
joint is taken for that.
"""

from __future__ import annotations

import numpy as np
import pytest

from support.oracles.account import assert_account_holds, reasons_in, reasons_of
from support.plants import fifth_plant, second_plant, sixth_plant
from support.product import (
    COLUMN,
    SIM_NO_TOOL,
    PortState,
    SampleRow,
    SimPort,
    VirtualStation,
    fell_too_fast,
)
from support.readers.repository import ROOT
from support.virtual.virtual_run import VirtualRun, line_text, prepare

PROFILES = ROOT / "profiles"
AWAY_S = 4.0
BACK_S = 8.0  # until its tool and its error have been read again
SCAN_S = 0.2  # a row begins before its last readings, which may show the empty port
ASKED_S = 0.02  # from a question to its answer
MOMENTS_S = np.random.default_rng(39).uniform(20.0, 50.0, 10).round(3).tolist()


def bench(rate: float | None = None) -> VirtualRun:
    """README's bench and a recipe for it, as `jbclog run` records it."""
    return prepare(
        (PROFILES / "lines/bench.toml").read_text(),
        (PROFILES / "recipes/sn100c-tht.toml").read_text(),
        duration_s=60.0,
        rate=rate,
    )


def port_of(run: VirtualRun, name: str, number: int) -> SimPort:
    station = run.stations[name]
    assert isinstance(station, VirtualStation)
    return station.plant.ports[number]


def pull(run: VirtualRun, second: float, name: str = "dde-1", number: int = 1) -> None:
    """Pull the tool out, and put it back, cold, `AWAY_S` later."""
    port = port_of(run, name, number)
    tool = port.tool
    run.at(second, lambda: port.plug(SIM_NO_TOOL))
    run.at(second + AWAY_S, lambda: port.plug(tool))


def rows_of(run: VirtualRun, name: str = "dde-1", number: int = 1) -> list[SampleRow]:
    return [
        row
        for row in run.memory.samples
        if (row[COLUMN["station"]], row[COLUMN["port"]]) == (name, number)
    ]


def seconds_of(run: VirtualRun, row: SampleRow) -> float:
    return float(str(row[COLUMN["time"]])) / 1e6 - run.utc_s(run.t0)


def assert_pulled(run: VirtualRun, moment: float, name: str = "dde-1", number: int = 1) -> None:
    """While the tool is away every row is `pulled` or `no_tool`, and before and after none is."""
    rows = rows_of(run, name, number)
    away = [row for row in rows if moment + ASKED_S < seconds_of(run, row) < moment + AWAY_S]
    words = [reasons_in(row).get("temperature_c") for row in away]
    assert set(words) <= {"pulled", "no_tool"}, words
    assert words == sorted(words, reverse=True), "forward only"
    assert words[0] == "pulled" or "no_tool" in words[:2]
    assert [row for row in away if row[COLUMN["temperature_c"]] is not None] == []
    for row in rows:
        if row[COLUMN["port_error"]] == 4:
            assert row[COLUMN["quality"]] == "no_tool"
            assert row[COLUMN["temperature_c"]] is row[COLUMN["power_permille"]] is None
    away_s = (moment - SCAN_S, moment + AWAY_S + BACK_S)
    present = [row for row in rows if not away_s[0] < seconds_of(run, row) < away_s[1]]
    assert {row[COLUMN["quality"]] for row in present} == {"ok"}
    lowest = min(int(str(row[COLUMN["temperature_c"]])) for row in present)
    assert lowest > 20


@pytest.mark.parametrize("moment", MOMENTS_S)
def test_at_ten_moments_on_the_bench(moment: float) -> None:
    run = bench()
    pull(run, moment)
    pull(run, moment + 0.7, "ale-1")
    run.go()
    assert_pulled(run, moment)
    assert_pulled(run, moment + 0.7, "ale-1")
    assert "pulled" in reasons_of(run, "temperature_c")
    reported = [one.station for one in run.memory.of_kind("read.pulled")]
    for name in ("dde-1", "ale-1"):
        words = [reasons_in(row).get("temperature_c") for row in rows_of(run, name)]
        assert ("pulled" in words) <= reported.count(name) <= 1


@pytest.mark.parametrize("rate", [1.0, 2.0, 5.0, "max"])
def test_at_every_rate(rate: float | str) -> None:
    run = prepare(line_text(), duration_s=40.0, rate=rate)
    pull(run, 20.3)
    run.go()
    assert_pulled(run, 20.3)
    assert_account_holds(run)


def test_without_a_port_error() -> None:
    """Some stations may not report it. Then the rows are `pulled` until the tool is back."""
    run = prepare(line_text(), duration_s=40.0)
    port = port_of(run, "dde-1", 1)
    run.at(20.3, lambda: setattr(port, "stuck_c", 0))
    run.at(30.3, lambda: setattr(port, "stuck_c", None))
    run.go()
    words = {
        reasons_in(row).get("temperature_c")
        for row in rows_of(run)
        if 20.3 < seconds_of(run, row) < 30.3
    }
    assert words == {"pulled"}
    asked = [one for one in run.heard if one.text == "RTT1" and 22 < one.at - run.t0 < 30]
    assert len(asked) == 80, "a refused value is not asked for again"
    assert {row[COLUMN["quality"]] for row in rows_of(run) if seconds_of(run, row) > 30.4} == {"ok"}


def test_a_joint_is_never_pulled() -> None:
    run = bench()
    run.go()
    assert "pulled" not in reasons_of(run, "temperature_c")


def first_refused(celsius: np.ndarray, period_s: float) -> int | None:
    """Return the place of the first reading that is taken for a pulled tool's."""
    port = PortState(1)
    for place, value in enumerate(celsius.tolist()):
        if value != value:  # not read
            continue
        at = place * period_s
        if fell_too_fast(port, round(value), at):
            return place
        port.temperatures_c["temperature_c"], port.temperature_at = round(value), at
    return None


@pytest.mark.parametrize("hz", [1.0, 10.0])
def test_no_joint_wipe_or_sponge_of_independent_tips_is_pulled(hz: float) -> None:
    courses = [
        trial.temperature for trial in second_plant.trials(second_plant.SEEDS[:9], rates=(hz,))[hz]
    ]
    seeds = list(range(39_001, 39_007))
    tips = ["small", "medium", "large"] * 2
    for plant in (fifth_plant, sixth_plant):
        kinds = zip(tips, seeds, strict=True)
        scripts = [plant.script_of(tip, 2.0, 3.0, seed) for tip, seed in kinds]
        courses += [trial.temperature for trial in plant.trials(scripts, seeds, (hz,))[hz]]
    assert len(courses) == 21
    assert [first_refused(course, 1 / hz) for course in courses] == [None] * 21


@pytest.mark.parametrize("hz", [0.1, 1.0, 5.0, 10.0, 60.0])
@pytest.mark.parametrize("before_c", [100.0, 350.0, 450.0])
def test_a_tip_in_boiling_water_is_not_pulled(before_c: float, hz: float) -> None:
    """It loses 150 °C/s, down to water of 15 °C: faster than anything in work."""
    seconds = np.arange(0, 20, 1 / hz)
    assert first_refused(np.maximum(before_c - 150 * seconds, 15.0), 1 / hz) is None


@pytest.mark.parametrize("hz", [0.1, 1.0, 5.0, 10.0, 60.0])
@pytest.mark.parametrize("before_c", [40, 150, 350, 450])
def test_zero_degrees_is_pulled_at_every_rate(before_c: int, hz: float) -> None:
    course = np.array([before_c] * 5 + [0] * 100, dtype=np.float64)
    assert first_refused(course, 1 / hz) == 5
