"""`jbclog safe`: what it orders of whom, what it leaves alone, and what it does not take for safe."""

from __future__ import annotations

import json

import pytest
from by_hand import Bench, Make, says, station_text

from jbclog import line_safe
from jbclog.commands.robot import TOOLS_002
from jbclog.errors import LinkError
from jbclog.sim.state import WORKING

STAND = "WPS100001"
T210, T245 = TOOLS_002[1], TOOLS_002[2]
DELAYS = "settings = {sleep_delay = 5, hibernation_delay = 30}"


@pytest.fixture(autouse=True)
def _no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(line_safe, "runs_that_hold", lambda urls: [])


def safe_text(name: str, family: str, sim: str = "") -> str:
    return station_text(name, family, sim=f"{sim}\n{DELAYS}")


def put_to_work(bench: Bench) -> Bench:
    """All tools at work, as a robot leaves them."""
    for wire in bench.wires.values():
        for port in wire.station.plant.ports.values():  # type: ignore[union-attr]  # soldering stations all
            port.order(WORKING, False)
    return bench


def writes(bench: Bench, name: str) -> list[str]:
    return bench.wires[name].writes


def test_each_tool_is_told_to_stand_and_read_back(make: Make) -> None:
    bench = put_to_work(make(safe_text("dme-1", "dme", "tools = {1 = 2, 2 = 1, 3 = 0, 4 = 2}")))
    bench.wait(20)
    ended = bench.do("safe")
    assert ended.code == 0
    assert ended.out.splitlines() == [
        f"dme-1 port 1 ({T245}): stand, as read back, 350 °C now",
        f"dme-1 port 2 ({T210}): stand, as read back, 351 °C now",
        f"dme-1 port 4 ({T245}): stand, as read back, 350 °C now",
        "dme-1 port 3: no tool",
    ]
    assert writes(bench, "dme-1") == [STAND, "WPS200001", "WPS400001"]
    assert ended.err == ""


@pytest.mark.parametrize(("last", "now"), [(False, ", 350 °C now"), (True, "")])
def test_no_temperature_is_told_that_one_answer_alone_says_or_that_cannot_be(make: Make, last: bool, now: str) -> None:
    bench = put_to_work(make(safe_text("dde-1", "dde", "tools = { 1 = 2, 2 = 0 }")))
    bench.wait(20)
    says(bench, "dde-1", "TT1", "04033", last=last)
    told = bench.do("safe").out
    assert "4033" not in told
    assert f"stand, as read back{now}\n" in told


def test_the_feeder_is_stopped_first(make: Make) -> None:
    bench = put_to_work(make(safe_text("ale-1", "ale")))
    feeder = bench.wires["ale-1"].station.plant.feeder  # type: ignore[union-attr]
    feeder.settings.feeder_mode = "continuous"
    feeder.start(bench.clock.monotonic())
    ended = bench.do("safe")
    assert (ended.code, ended.out.splitlines()[0]) == (0, "ale-1: feeder stopped")
    assert writes(bench, "ale-1") == ["WSTP00000", STAND]
    assert feeder.motor(bench.clock.monotonic()) == 0


@pytest.mark.parametrize(("seconds", "state"), [(60, "stand"), (360, "sleep"), (3600, "hibernation")])
def test_a_tool_that_rests_already_is_not_woken(make: Make, seconds: float, state: str) -> None:
    bench = put_to_work(make(safe_text("dde-1", "dde", "tools = {1 = 2, 2 = 0}")))
    bench.do("write", "dde-1", "status", "stand", "--port", "1")
    bench.wait(seconds)
    before = len(writes(bench, "dde-1"))
    ended = bench.do("safe")
    assert ended.code == 0
    assert f"port 1 ({T245}): {state}, as it was already" in ended.out
    assert writes(bench, "dde-1")[before:] == []


@pytest.mark.parametrize(("cools", "told"), [(True, []), (False, [STAND])])
def test_an_extractor_state_is_left_alone_where_the_tip_cools(make: Make, cools: bool, told: list[str]) -> None:
    bench = make(safe_text("ucr-1", "ucr", f"tool = 9\nextractor_cools = {str(cools).lower()}"))
    bench.wait(20)
    bench.do("write", "ucr-1", "status", "extractor")
    bench.wait(20)
    before = len(writes(bench, "ucr-1"))
    assert bench.do("safe").code == 0
    assert writes(bench, "ucr-1")[before:] == told


@pytest.mark.parametrize("delay", ["5", '"off"'])
def test_a_cold_tool_in_its_extractor_state_is_not_heated(make: Make, delay: str) -> None:
    """Of no family: told to stand, it would be. Delays that are off keep no tool hot that does not stand."""
    bench = make(station_text("dde-1", "dde", sim=f"tools = {{1 = 2, 2 = 0}}\nsettings = {{sleep_delay = {delay}}}"))
    bench.wires["dde-1"].station.plant.ports[1].order(WORKING, True)  # type: ignore[union-attr]
    bench.wait(3600)
    ended = bench.do("safe")
    assert (ended.code, ended.err, writes(bench, "dde-1")) == (0, "", [])
    assert f"port 1 ({T245}): extractor, as it was already" in ended.out


def test_hot_air_is_told_to_cool(make: Make) -> None:
    bench = make(station_text("jtse-1", "jtse", sim="tool = 1"))
    bench.do("write", "jtse-1", "status", "on")
    before = len(writes(bench, "jtse-1"))
    ended = bench.do("safe")
    assert ended.code == 0
    assert "jtse-1 port 1" in ended.out
    assert writes(bench, "jtse-1")[before:] == ["WPS100010"]


def test_hot_air_is_told_to_cool_and_keeps_what_it_holds(make: Make) -> None:
    """Nobody's recipe is known here: what suction holds is not let go."""
    bench = make(station_text("jtse-1", "jtse", sim="tool = 1"))
    bench.do("write", "jtse-1", "status", "on+suction")
    before = len(writes(bench, "jtse-1"))
    assert bench.do("safe").code == 0
    assert writes(bench, "jtse-1")[before:] == ["WPS100110"]


@pytest.mark.parametrize(
    ("delays", "off"),
    [
        ("sleep_delay = 99999, hibernation_delay = 30", "sleep delay is"),
        ("sleep_delay = 5, hibernation_delay = 99999", "hibernation delay is"),
        ("sleep_delay = 99999, hibernation_delay = 99999", "sleep delay and hibernation delay are"),
    ],
)
def test_a_tool_that_stands_and_never_cools_is_not_safe(make: Make, delays: str, off: str) -> None:
    bench = put_to_work(
        make(station_text("dde-1", "dde", sim=f"tools = {{1 = 2, 2 = 0}}\nsettings = {{{delays}}}".replace("99999", '"off"')))
    )
    ended = bench.do("safe")
    assert writes(bench, "dde-1") == [STAND]
    assert ended.code == 5
    assert f"port 1 ({T245}): NOT SAFE" in ended.out
    assert f"error: dde-1 port 1: its {off} off, so it never cools down: switch the station off" in ended.err


def test_a_family_to_be_learnt_is_learnt(make: Make) -> None:
    bench = put_to_work(make(safe_text("x", "auto", 'model = "NAE"')))
    assert bench.do("safe").code == 0
    assert writes(bench, "x") == [STAND, "WPS200001"]


def test_what_really_is_there_counts_and_not_what_the_line_file_says(make: Make) -> None:
    bench = put_to_work(make(safe_text("dde-1", "dde", 'model = "NAE"')))
    ended = bench.do("safe")
    assert (ended.code, writes(bench, "dde-1")) == (0, [STAND, "WPS200001"])
    assert "note: dde-1: the line file says family dde, the station says model NAE and was spoken to as such" in ended.err


def test_nothing_is_written_to_a_stranger(make: Make) -> None:
    bench = make(safe_text("dde-1", "dde", 'model = "XYZ"'))
    ended = bench.do("safe")
    assert (ended.code, writes(bench, "dde-1"), ended.out) == (5, [], "dde-1: NOT SAFE\n")
    assert "the station says model XYZ; nothing was written to it. It may be hot: switch the station off" in ended.err


def test_an_omega_takes_no_such_order(make: Make) -> None:
    bench = make(station_text("omega-1", "omega", keys='baudrate = 9600\nformat = "8N1"'))
    ended = bench.do("safe")
    assert (ended.code, writes(bench, "omega-1")) == (5, [])
    assert "takes no order that would make it safe: stop it at its own panel" in ended.err


def test_robot_mode_that_is_off_is_said(make: Make) -> None:
    bench = make(safe_text("dde-1", "dde", "robot_mode = false"))
    ended = bench.do("safe")
    assert (ended.code, ended.out) == (5, "dde-1: NOT SAFE\n")
    assert "Robot mode is off" in ended.err


def test_a_cable_that_is_put_back_in_time_is_time_enough(make: Make) -> None:
    bench = make(safe_text("dde-1", "dde"))
    back_at = bench.clock.monotonic() + 3.0

    def watch(text: str) -> None:
        if bench.clock.monotonic() < back_at:
            raise LinkError("the cable is out")

    bench.wires["dde-1"].watch = watch
    assert bench.do("safe").code == 0


def test_a_cable_that_stays_out_is_told_with_what_to_do(make: Make) -> None:
    bench = make(safe_text("dde-1", "dde"))

    def watch(text: str) -> None:
        raise LinkError("the cable is out")

    bench.wires["dde-1"].watch = watch
    ended = bench.do("safe")
    assert (ended.code, ended.err) == (5, "error: dde-1: the cable is out; its tools may be hot: switch the station off\n")


def test_an_order_that_is_only_acknowledged_is_not_safe(make: Make) -> None:
    bench = put_to_work(make(safe_text("dde-1", "dde", "tools = {1 = 2, 2 = 0}")))
    bench.wires["dde-1"].only_acknowledged = "WPS1"
    ended = bench.do("safe")
    assert (ended.code, ended.out.splitlines()[0].partition(" NOT SAFE")[0]) == (5, f"dde-1 port 1 ({T245}):")
    assert "error: dde-1 port 1: it was told to rest and does not confirm it; it may be hot: switch the station off" in ended.err


def test_json_tells_it_tool_by_tool(make: Make) -> None:
    bench = put_to_work(make(safe_text("ale-1", "ale")))
    told = json.loads(bench.do("safe", "--json").out)
    (station,) = told["stations"]
    (tool,) = station["tools"]
    assert (told["exit_code"], told["runs"], station["safe"], station["feeder"], station["model"]) == (
        0,
        [],
        True,
        "stopped",
        "ALE",
    )
    assert (tool["port"], tool["state"], tool["safe"], tool["rested"], tool["problem"]) == (1, "stand", True, False, None)
