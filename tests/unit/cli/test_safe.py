"""`jbclog safe`: what it orders of whom, what it leaves alone, what it does not call safe."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from jbclog.app import safe_state
from jbclog.app.safe_state import GuardsAtWork
from jbclog.cli.app import app
from jbclog.core.errors import LinkError
from jbclog.guard.inquiry import Unsafe
from jbclog.guard.lease import StationLease, read_leases, write_leases
from jbclog.protocol.commands.robot import TOOLS_002
from jbclog.sim.port import WORKING
from support.campaigns.awaited import LEFT_HOT_NOTED
from support.faults.guarded import actions_in
from support.virtual.manual import Bench, Ended, Make, says, station_text

STAND = "WPS100001"
T210, T245 = TOOLS_002[1], TOOLS_002[2]
DELAYS = "settings = {sleep_delay = 5, hibernation_delay = 30}"


@pytest.fixture(autouse=True)
def _no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(safe_state, "runs_that_hold", lambda urls: [])


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
        f"dme-1 port 1 ({T245}): set to stand, 350 °C, sleeps in 5 min",
        f"dme-1 port 2 ({T210}): set to stand, 350 °C, sleeps in 5 min",
        f"dme-1 port 4 ({T245}): set to stand, 350 °C, sleeps in 5 min",
        "dme-1 port 3: no tool",
    ]
    assert writes(bench, "dme-1") == [STAND, "WPS200001", "WPS400001"]
    assert ended.err == ""


@pytest.mark.usefixtures("own_state")
def test_a_run_that_left_its_tools_hot_is_named_and_its_lease_closed(
    make: Make, tmp_path: Path
) -> None:
    bench = put_to_work(make(safe_text("dde-1", "dde", "tools = {1 = 2, 2 = 0}")))
    run, url = tmp_path / "run", bench.target("dde-1").url
    run.mkdir()
    lease = StationLease(
        "dde-1", url, 19200, "8N1", 1, "dde", "DDE", None, "stand", (1,), feeds=False
    )
    write_leases(run, [lease])
    ended = bench.do("safe")
    assert (ended.code, ended.err) == (0, f"run {run} {LEFT_HOT_NOTED}\n")
    assert read_leases(run) == []
    assert [kind for kind, *_ in actions_in(run)] == ["safety.safe_state", "guard.left_over"]


@pytest.mark.parametrize(("last", "now"), [(False, ", 350 °C"), (True, ", temperature not known")])
def test_no_temperature_is_told_that_one_answer_alone_says_or_that_cannot_be(
    make: Make, last: bool, now: str
) -> None:
    bench = put_to_work(make(safe_text("dde-1", "dde", "tools = { 1 = 2, 2 = 0 }")))
    bench.wait(20)
    says(bench, "dde-1", "TT1", "04033", last=last)
    told = bench.do("safe").out
    assert "4033" not in told
    assert f"set to stand{now}, sleeps in 5 min\n" in told


def test_the_feeder_is_stopped_first(make: Make) -> None:
    bench = put_to_work(make(safe_text("ale-1", "ale")))
    feeder = bench.wires["ale-1"].station.plant.feeder  # type: ignore[union-attr]
    feeder.settings.feeder_mode = "continuous"
    feeder.start(bench.clock.monotonic())
    ended = bench.do("safe")
    assert (ended.code, ended.out.splitlines()[0]) == (0, "ale-1: feeder stopped")
    assert writes(bench, "ale-1") == ["WSTP00000", STAND]
    assert feeder.motor(bench.clock.monotonic()) == 0


@pytest.mark.parametrize(
    ("seconds", "state"),
    [
        (60, "already in stand, 350 °C, sleeps in 4 min"),
        (360, "already asleep, 150 °C, hibernates in 29 min"),
        (3600, "already in hibernation, 23 °C, its heater is off"),
    ],
)
def test_a_tool_that_rests_already_is_not_woken(make: Make, seconds: float, state: str) -> None:
    bench = put_to_work(make(safe_text("dde-1", "dde", "tools = {1 = 2, 2 = 0}")))
    bench.do("write", "dde-1", "status", "stand", "--port", "1")
    bench.wait(seconds)
    before = len(writes(bench, "dde-1"))
    ended = bench.do("safe")
    assert ended.code == 0
    assert f"port 1 ({T245}): {state}\n" in ended.out
    assert writes(bench, "dde-1")[before:] == []


@pytest.mark.parametrize(("cools", "told"), [(True, []), (False, [STAND])])
def test_an_extractor_state_is_left_alone_where_the_tip_cools(
    make: Make, cools: bool, told: list[str]
) -> None:
    bench = make(safe_text("ucr-1", "ucr", f"tool = 9\nextractor_cools = {str(cools).lower()}"))
    bench.wait(20)
    bench.do("write", "ucr-1", "status", "extractor")
    bench.wait(20)
    before = len(writes(bench, "ucr-1"))
    assert bench.do("safe").code == 0
    assert writes(bench, "ucr-1")[before:] == told


@pytest.mark.parametrize("delay", ["5", '"off"'])
def test_a_cold_tool_in_its_extractor_state_is_not_heated(make: Make, delay: str) -> None:
    """Of no family: set to stand, it would be. Delays that are off keep no tool hot that does not
    stand.
    """
    bench = make(
        station_text(
            "dde-1", "dde", sim=f"tools = {{1 = 2, 2 = 0}}\nsettings = {{sleep_delay = {delay}}}"
        )
    )
    bench.wires["dde-1"].station.plant.ports[1].order(WORKING, True)  # type: ignore[union-attr]
    bench.wait(3600)
    ended = bench.do("safe")
    assert (ended.code, ended.err, writes(bench, "dde-1")) == (0, "", [])
    assert f"port 1 ({T245}): already in extractor, 23 °C, cold or cooling\n" in ended.out


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
        make(
            station_text(
                "dde-1",
                "dde",
                sim=f"tools = {{1 = 2, 2 = 0}}\nsettings = {{{delays}}}".replace("99999", '"off"'),
            )
        )
    )
    ended = bench.do("safe")
    assert writes(bench, "dde-1") == [STAND]
    assert ended.code == 5
    assert f"port 1 ({T245}): NOT SAFE, set to stand, " in ended.out
    what = "hibernate" if off.startswith("hibernation") else "sleep"
    assert f"will not {what} by itself, its delay is off\n" in ended.out
    assert (
        f"error: dde-1 port 1: its {off} off, so it never cools down: switch the station off"
        in ended.err
    )


def test_a_family_to_be_learnt_is_learnt(make: Make) -> None:
    bench = put_to_work(make(safe_text("x", "auto", 'model = "NAE"')))
    assert bench.do("safe").code == 0
    assert writes(bench, "x") == [STAND, "WPS200001"]


def test_what_really_is_there_counts_and_not_what_the_line_file_says(make: Make) -> None:
    bench = put_to_work(make(safe_text("dde-1", "dde", 'model = "NAE"')))
    ended = bench.do("safe")
    assert (ended.code, writes(bench, "dde-1")) == (0, [STAND, "WPS200001"])
    assert (
        "note: dde-1: the line file says family dde, the station says model NAE and was spoken to"
        " as such" in ended.err
    )


def test_nothing_is_written_to_a_stranger(make: Make) -> None:
    bench = make(safe_text("dde-1", "dde", 'model = "XYZ"'))
    ended = bench.do("safe")
    assert (ended.code, writes(bench, "dde-1"), ended.out) == (5, [], "dde-1: NOT SAFE\n")
    assert (
        "the station says model XYZ; nothing was written to it. It may be hot: switch the"
        " station off" in ended.err
    )


def test_an_omega_takes_no_such_order(make: Make) -> None:
    bench = make(station_text("omega-1", "omega", keys='baudrate = 9600\nformat = "8N1"'))
    ended = bench.do("safe")
    assert (ended.code, writes(bench, "omega-1")) == (5, [])
    assert (
        "has no safe state, it takes no order that would make it safe: stop it at its own panel"
        in ended.err
    )
    assert ended.out == "omega-1: NOT SAFE, no safe state, temperature not known\n"


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
    assert (ended.code, ended.err) == (
        5,
        "error: dde-1: the cable is out; its tools may be hot: switch the station off\n",
    )


def test_an_order_that_is_only_acknowledged_is_not_safe(make: Make) -> None:
    bench = put_to_work(make(safe_text("dde-1", "dde", "tools = {1 = 2, 2 = 0}")))
    bench.wires["dde-1"].only_acknowledged = "WPS1"
    ended = bench.do("safe")
    assert (ended.code, ended.out.splitlines()[0].partition(" NOT SAFE")[0]) == (
        5,
        f"dde-1 port 1 ({T245}):",
    )
    assert (
        "error: dde-1 port 1: it was ordered to rest and does not confirm it; it may be hot: switch"
        " the station off" in ended.err
    )


def test_json_tells_it_tool_by_tool(make: Make) -> None:
    bench = put_to_work(make(safe_text("ale-1", "ale")))
    told = json.loads(bench.do("safe", "--json").out)
    (station,) = told["stations"]
    (tool,) = station["tools"]
    assert (
        told["exit_code"],
        told["runs"],
        station["safe"],
        station["feeder"],
        station["model"],
    ) == (
        0,
        [],
        True,
        "stopped",
        "ALE",
    )
    assert (tool["port"], tool["state"], tool["safe"], tool["rested"], tool["problem"]) == (
        1,
        "stand",
        True,
        False,
        None,
    )


# -- safe is not cold ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("family", "tool"),
    [("soldering", 2), ("dde", 2), ("nae", 5), ("dme", 2), ("hde", 2), ("ucr", 9), ("ale", 2)],
)
def test_each_family_says_what_is_known_of_its_tool(make: Make, family: str, tool: int) -> None:
    bench = put_to_work(make(safe_text("x", family, f"joints_per_minute = 0\ntool = {tool}")))
    bench.wait(30)
    ended = bench.do("safe")
    (told,) = (text for text in ended.out.splitlines() if "port 1 (" in text)
    assert (ended.code, told.partition("): ")[2]) == (0, "set to stand, 350 °C, sleeps in 5 min")


@pytest.mark.parametrize(
    ("order", "first", "last"),
    [
        ("on", "set to cool", "its heater is off"),
        ("on+suction", "set to cool", "its heater is off, suction on"),
        ("cooling", "already in cooling", "its heater is off"),
        ("off", "already in off", "its heater is off"),
    ],
)
def test_hot_air_says_that_its_heater_is_off(make: Make, order: str, first: str, last: str) -> None:
    bench = make(station_text("jtse-1", "jtse", sim="tool = 1\njoints_per_minute = 0"))
    station = bench.wires["jtse-1"].station.device.face.station  # type: ignore[union-attr]
    station.heater.temperature_c = 200.0
    bench.do("write", "jtse-1", "status", order)
    told = bench.do("safe").out.strip().partition("): ")[2]
    assert (told.startswith(f"{first}, "), told.endswith(f" °C, {last}")) == (True, True), told


@pytest.mark.parametrize(
    ("silent", "unknown"),
    [
        ("tip_temperature", "temperature not known"),
        ("time_to_sleep", "when it sleeps is not known"),
    ],
)
def test_what_cannot_be_read_is_said_as_not_known(make: Make, silent: str, unknown: str) -> None:
    sim = (
        f"tools = {{1 = 2, 2 = 0}}\n{DELAYS}\n[[station.sim.fault]]\nkind = 'silence'\ncommand ="
        f" '{silent}'"
    )
    bench = put_to_work(make(station_text("dde-1", "dde", sim=sim)))
    ended = bench.do("safe")
    assert (ended.code, unknown in ended.out) == (0, True)


def cooling_bench(make: Make, sleep: int = 1, hibernation: int = 5, more: str = "") -> Bench:
    delays = f"settings = {{sleep_delay = {sleep}, hibernation_delay = {hibernation}}}"
    sim = f"tools = {{1 = 2, 2 = 1}}\njoints_per_minute = 0\n{delays}\n{more}"
    bench = put_to_work(make(station_text("dde-1", "dde", sim=sim)))
    bench.wait(60)
    return bench


def test_waiting_ends_when_all_are_below(make: Make) -> None:
    bench = cooling_bench(make)
    begun = bench.clock.monotonic()
    ended = bench.do("safe", "--wait")
    assert ended.code == 0, ended.err
    assert 360 < bench.clock.monotonic() - begun < safe_state.COLD_WITHIN_S
    for number, port in bench.wires["dde-1"].station.plant.ports.items():  # type: ignore[union-attr]
        assert port.temperature() < 60
        assert f"dde-1 port {number} " in ended.out
    assert ended.out.count("below 60 °C after ") == 2
    assert "waiting for dde-1 port 1 (" in ended.err
    # nothing but the orders is written
    assert all(one.startswith("WPS") for one in writes(bench, "dde-1"))


def test_waiting_for_less_takes_less(make: Make) -> None:
    bench = cooling_bench(make)
    begun = bench.clock.monotonic()
    ended = bench.do("safe", "--wait", "--below", "200")
    assert (ended.code, bench.clock.monotonic() - begun < 180, ended.out.count("below 200 °C")) == (
        0,
        True,
        2,
    )


def test_after_half_an_hour_what_is_still_above_is_named_with_its_last_temperature(
    make: Make,
) -> None:
    bench = cooling_bench(make, 5, 60)
    begun = bench.clock.monotonic()
    ended = bench.do("safe", "--wait")
    assert ended.code == 1
    assert abs(bench.clock.monotonic() - begun - safe_state.COLD_WITHIN_S) < 10
    assert "error: dde-1 port 1: 150 °C, not known to be below 60 °C after 30 min" in ended.err
    assert "error: dde-1 port 2: 150 °C" in ended.err


def test_a_temperature_that_is_not_told_never_counts_as_cold(make: Make) -> None:
    bench = cooling_bench(
        make, more="[[station.sim.fault]]\nkind = 'silence'\ncommand = 'tip_temperature'\nport = 2"
    )
    ended = bench.do("safe", "--wait", "--json")
    told = json.loads(ended.out)
    assert (ended.code, told["exit_code"], told["below_c"], told["waited_s"] >= 1800) == (
        1,
        1,
        60,
        True,
    )
    first, second = told["stations"][0]["tools"]
    assert (first["cold"], first["temperature_c"] < 60) == (True, True)
    assert (second["cold"], second["temperature_c"]) == (False, None)
    assert (
        "error: dde-1 port 2: temperature not known, not known to be below 60 °C after 30 min"
        in ended.err
    )


def test_a_tool_that_was_taken_out_is_not_cold(make: Make) -> None:
    """Its port tells 0 °C; nobody knows of the cartridge."""
    bench = cooling_bench(make)
    port = bench.wires["dde-1"].station.plant.ports[1]  # type: ignore[union-attr]
    asked: list[str] = []

    def pull(text: str) -> None:
        asked.append(text)
        if asked.count("RSMN") > 6 and port.tool:
            port.plug(0)

    bench.wires["dde-1"].watch = pull
    ended = bench.do("safe", "--wait")
    assert ended.code == 1
    assert "error: dde-1 port 1: temperature not known (last read 3" in ended.err


def test_another_station_in_its_place_is_not_the_one_that_was_waited_for(make: Make) -> None:
    bench = cooling_bench(make)
    asked: list[str] = []

    def exchange(text: str) -> None:
        asked.append(text)
        if asked.count("RSMN") > 6:
            bench.wires["dde-1"].station.device.identity.model = "NAE"  # type: ignore[union-attr]

    bench.wires["dde-1"].watch = exchange
    assert bench.do("safe", "--wait").code == 1


def test_what_is_not_safe_is_told_also_after_waiting(make: Make) -> None:
    bench = make(station_text("omega-1", "omega", keys='baudrate = 9600\nformat = "8N1"'))
    assert bench.do("safe", "--wait").code == 5


def test_a_limit_without_waiting_is_refused_before_anything_is_sent(make: Make) -> None:
    bench = make(safe_text("dde-1", "dde"))
    ended = bench.do("safe", "--below", "80")
    assert (ended.code, bench.wires["dde-1"].heard) == (2, [])
    assert "--below requires --wait" in ended.err


def test_json_tells_what_follows(make: Make) -> None:
    bench = put_to_work(
        make(safe_text("dde-1", "dde", "tools = {1 = 2, 2 = 0}\njoints_per_minute = 0"))
    )
    bench.wait(30)
    (tool,) = json.loads(bench.do("safe", "--json").out)["stations"][0]["tools"]
    assert (tool["told"], tool["next"], tool["next_in_s"], tool["never"], tool["cold"]) == (
        "stand",
        "sleep",
        300,
        [],
        None,
    )
    assert tool["text"] == "set to stand, 350 °C, sleeps in 5 min"


# -- stations that do not answer -------------------------------------------------------------------

JTSE = "WPS100010"


def insisted(bench: Bench, reply: str) -> Ended:
    words = ["safe", "--unanswered", "--line", str(bench.line)]
    ended = CliRunner().invoke(app, words, obj=bench.access, input=reply)
    return Ended(ended.exit_code, ended.stdout, ended.stderr)


def silenced(bench: Bench, *names: str) -> Bench:
    """They hear, and do not answer."""
    for name in names:
        bench.wires[name].station.receive = lambda data, now: []  # type: ignore[method-assign,union-attr]
    return bench


@pytest.mark.usefixtures("own_state")
@pytest.mark.parametrize(
    ("station", "family", "orders"),
    [
        ("dde-1", "dde", [STAND, "WPS200001"]),
        ("ale-1", "ale", ["WSTP00000", STAND]),
        ("jtse-1", "jtse", [JTSE]),
    ],
)
def test_who_insists_orders_a_silent_station_once(
    make: Make, tmp_path: Path, station: str, family: str, orders: list[str]
) -> None:
    bench = silenced(make(station_text(station, family)), station)
    run = tmp_path / "run"
    run.mkdir()
    url = bench.target(station).url
    lease = StationLease(station, url, 19200, "8N1", 1, family, "X", None, "", (1,), feeds=False)
    write_leases(run, [lease])
    before = bench.do("safe")
    assert before.code == 5
    assert writes(bench, station) == []
    ended = insisted(bench, "y\n")
    assert ended.code == 5
    assert writes(bench, station) == orders
    for words in (station, "another station", "would be warmed"):
        assert words in ended.err
    assert f"{station} port 1 (tool unknown): NOT SAFE" in ended.out
    ((kind, _, port, text),) = actions_in(run)
    assert (kind, port) == ("safety.not_safe", 1)
    assert text.startswith("jbclog safe --unanswered: ")
    assert "was ordered once without an answer, not confirmed" in text
    assert read_leases(run) == [lease]


@pytest.mark.usefixtures("own_state")
@pytest.mark.parametrize("reply", ["", "n\n"])
def test_who_does_not_say_yes_orders_nothing(make: Make, reply: str) -> None:
    bench = silenced(make(station_text("dde-1", "dde")), "dde-1")
    ended = insisted(bench, reply)
    assert (ended.code, writes(bench, "dde-1")) == (5, [])
    assert "No order sent. Switch the station off" in ended.err


@pytest.mark.usefixtures("own_state")
@pytest.mark.parametrize("other", ["jtse", "auto"])
def test_on_a_mixed_line_nobody_is_asked(make: Make, other: str) -> None:
    sim = 'model = "DDE"' if other == "auto" else ""
    stations = station_text("dde-1", "dde"), station_text("other", other, sim=sim)
    bench = silenced(make(*stations), "dde-1")
    ended = insisted(bench, "y\n")
    assert (ended.code, writes(bench, "dde-1")) == (5, [])
    assert "no order sent to dde-1" in ended.err
    assert "Switch the station off" in ended.err


@pytest.mark.usefixtures("own_state")
def test_a_station_that_a_guard_has_ordered_is_named_and_not_ordered_again(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = silenced(make(station_text("dde-1", "dde")), "dde-1")
    unsafe = Unsafe("dde-1", bench.target("dde-1").url, {1: "it does not answer"}, orders=3)
    monkeypatch.setattr(GuardsAtWork, "report", lambda guards, url: (tmp_path, unsafe))
    ended = insisted(bench, "y\n")
    assert (ended.code, writes(bench, "dde-1")) == (5, [])
    assert f"the guard of the run {tmp_path} has ordered it 3 times without an answer" in ended.err


@pytest.mark.usefixtures("own_state")
def test_a_station_that_answers_is_never_ordered_without_an_answer(make: Make) -> None:
    bench = put_to_work(make(safe_text("dde-1", "dde", "tools = {1 = 2, 2 = 0}")))
    ended = insisted(bench, "y\n")
    assert (ended.code, ended.err) == (0, "")
    assert writes(bench, "dde-1") == [STAND]
