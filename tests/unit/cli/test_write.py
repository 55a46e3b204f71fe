"""`jbclog write`: once, read back, told as it is; what is dangerous only when it is meant."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.app import connection
from jbclog.core.errors import LinkError, PortBusy
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.family import FAMILIES
from jbclog.transport.port import Port
from support.virtual.manual import Bench, Ended, Make, station_text

TOOLS = "tools = { 1 = 2, 2 = 1 }"
STAND = "jbclog write dde-1 status stand --port 1 --line"


def dde(sim: str = TOOLS) -> str:
    return station_text("dde-1", "dde", sim=sim)


def ale(sim: str = "") -> str:
    return station_text("ale-1", "ale", sim=sim)


def fault(kind: str, more: str) -> str:
    return f"[[station.sim.fault]]\nkind = '{kind}'\n{more}\n"


def unplugged_at(bench: Bench, name: str, beginning: str) -> None:
    """The cable of that station is pulled with the question that begins so."""

    def watch(text: str) -> None:
        if text.startswith(beginning):
            raise LinkError("the cable is out")

    bench.wires[name].watch = watch


def writes(bench: Bench, name: str = "dde-1") -> list[str]:
    return bench.wires[name].writes


# -- one write -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "sent", "told"),
    [
        (
            ("selected_temperature", "360"),
            "WST100360",
            "selected_temperature of port 1: 360 °C, confirmed (350 °C before)",
        ),
        (("adjust", "-5"), "WA12-0005", "adjust of port 1, tool 2: -5 °C, confirmed (0 °C before)"),
        (
            ("adjust", "7", "--tool", "3"),
            "WA1300007",
            "adjust of port 1, tool 3: 7 °C, confirmed (0 °C before)",
        ),
        (
            ("sleep_delay", "off"),
            "WD1299999",
            "sleep_delay of port 1, tool 2: off, confirmed (5 min before)",
        ),
        (
            ("alarm_high_limit", "380"),
            "WHA100380",
            "alarm_high_limit of port 1: 380 °C, confirmed (not set before)",
        ),
        (
            ("alarm_high_delay", "1.6"),
            "WHD101.60",
            "alarm_high_delay of port 1: 1.60 s, confirmed (off before)",
        ),
        (("status", "stand"), "WPS100001", "status of port 1: stand, confirmed (extractor before)"),
    ],
)
def test_it_is_written_once_and_read_back(
    make: Make, words: tuple[str, ...], sent: str, told: str
) -> None:
    bench = make(dde())
    ended = bench.do("write", "dde-1", *words, "--port", "1")
    assert (ended.code, ended.out, ended.err) == (0, f"{told}\n", "")
    assert writes(bench) == [sent]
    read_back = bench.do("read", "dde-1", words[0], "--port", "1", *words[2:])
    assert read_back.out.strip() in told


@pytest.mark.parametrize(
    ("sim", "code", "told"),
    [
        ("", 0, "sleep_delay of port 1: 300 min, confirmed"),
        ("refuses_unprinted = true", 3, "N 00003"),
    ],
)
def test_what_an_older_station_s_manual_does_not_print_is_its_own_to_refuse(
    make: Make, sim: str, code: int, told: str
) -> None:
    bench = make(station_text("old-1", "soldering", sim=sim))
    ended = bench.do("write", "old-1", "sleep_delay", "300", "--port", "1", "--tool", "2")
    assert ended.code == code
    assert told.replace("port 1:", "port 1, tool 2:") in ended.out + ended.err
    assert (
        "note: sleep_delay: 300 min is not within 0 to 9 min, in steps of 1 (002 W-Dxy). Manual 000"
        " prints" in ended.err
    )
    assert writes(bench, "old-1") == ["WD1200300"]


@pytest.mark.parametrize("name", ["ale", "dde", "ucr"])
def test_a_fuse_error_is_ignored_on_every_station_of_002(make: Make, name: str) -> None:
    bench = make(station_text("s-1", name))
    assert bench.do("write", "s-1", "ignore_fuse_error", "--yes-i-mean", "s-1").code == 0
    assert writes(bench, "s-1") == ["WIFE00000"]


def test_without_the_station_s_own_maximum_no_temperature_is_written(make: Make) -> None:
    bench = make(dde(fault("nak", "command = 'maximum_temperature'\ncode = 4")))
    ended = bench.do("write", "dde-1", "selected_temperature", "300", "--port", "1")
    assert (
        ended.code,
        "does not answer its maximum_temperature; nothing was written" in ended.err,
    ) == (3, True)
    assert writes(bench) == []


def test_what_is_so_already_is_not_sent(make: Make) -> None:
    bench = make(dde())
    ended = bench.do("write", "dde-1", "selected_temperature", "350", "--port", "1")
    assert (ended.code, ended.out) == (
        0,
        "selected_temperature of port 1: already 350 °C; nothing sent\n",
    )
    assert writes(bench) == []


def test_a_tool_s_state_is_ordered_whatever_it_says_that_it_is(make: Make) -> None:
    bench = make(dde(f"{TOOLS}\nsettings = {{ status = 'stand' }}"))
    assert bench.do("write", "dde-1", "status", "stand", "--port", "1").code == 0
    bench.wait(6 * 60)  # and beyond its sleep delay
    ended = bench.do("write", "dde-1", "status", "stand", "--port", "1")
    assert (ended.code, "confirmed (sleep before)" in ended.out) == (0, True)
    assert writes(bench) == ["WPS100001", "WPS100001"]


def test_a_station_with_one_port_needs_none_named(make: Make) -> None:
    bench = make(ale())
    assert bench.do("write", "ale-1", "selected_temperature", "300").code == 0
    assert (
        bench.do("write", "ale-1", "feeder_length", "5.5").out
        == "feeder_length: 5.50 mm, confirmed (5.00 mm before)\n"
    )
    assert bench.do("write", "ale-1", "feeder_mode", "program").code == 0
    assert writes(bench, "ale-1") == ["WST100300", "WLEN00055", "WMOD00002"]


def test_a_write_as_json(make: Make) -> None:
    bench = make(dde())
    told = json.loads(
        bench.do("write", "dde-1", "selected_temperature", "360", "--port", "1", "--json").out
    )
    assert told.pop("time").endswith("Z")
    assert told == {
        "station": "dde-1",
        "command": "selected_temperature",
        "port": 1,
        "tool": None,
        "requested": 360,
        "before": 350,
        "readback": 360,
        "uom": "°C",
        "outcome": "confirmed",
        "problem": "",
        "manual": "002 W-STx",
        "snapshot": None,
        "exit_code": 0,
    }


# -- what goes wrong -------------------------------------------------------------------------------


def test_a_lost_acknowledgement_is_settled_by_reading(make: Make) -> None:
    bench = make(dde(fault("silence", "command = 'selected_temperature'\nonly = 'write'")))
    assert bench.do("write", "dde-1", "selected_temperature", "360", "--port", "1").code == 0
    assert writes(bench) == ["WST100360"]


def refused(bench: Bench, *words: str) -> Ended:
    ended = bench.do("write", "dde-1", *words)
    assert ended.out == ""
    return ended


def test_what_the_station_refuses_is_told_with_what_was_before(make: Make) -> None:
    bench = make(dde(fault("nak", "command = 'selected_temperature'\nonly = 'write'\ncode = 3")))
    ended = refused(bench, "selected_temperature", "360", "--port", "1")
    assert ended.code == 3
    assert (
        ended.err
        == "error: dde-1: selected_temperature of port 1: requested 360 °C, refused with N 00003,"
        " value out of range (350 °C before)\n"
    )
    assert writes(bench) == ["WST100360"]


def test_what_is_acknowledged_and_not_done_is_a_mismatch(make: Make) -> None:
    bench = make(dde())
    bench.wires["dde-1"].only_acknowledged = "WST1"
    ended = refused(bench, "selected_temperature", "360", "--port", "1")
    assert ended.code == 3
    assert "requested 360 °C, 350 °C was read back (350 °C before)" in ended.err
    told = json.loads(
        bench.do("write", "dde-1", "selected_temperature", "360", "--port", "1", "--json").out
    )
    assert (told["outcome"], told["readback"], told["exit_code"]) == ("mismatch", 350, 3)


def test_a_reading_back_that_is_refused_is_no_refused_write(make: Make) -> None:
    bench = make(
        dde(fault("nak", "command = 'selected_temperature'\nonly = 'read'\ncode = 5\nat_s = 5"))
    )
    bench.do("read", "dde-1", "model")
    bench.wires["dde-1"].watch = lambda text: bench.wait(5) if text.startswith("WST1") else None
    ended = refused(bench, "selected_temperature", "360", "--port", "1")
    assert ended.code == 3
    assert "requested 360 °C, sent, not confirmed: " in ended.err
    assert "Robot mode is off (350 °C before)" in ended.err


def test_a_cable_that_goes_leaves_it_open(make: Make) -> None:
    bench = make(dde())
    unplugged_at(bench, "dde-1", "WST1")
    ended = refused(bench, "selected_temperature", "360", "--port", "1")
    assert ended.code == 3
    assert "sent, not confirmed: the cable is out (350 °C before)" in ended.err
    assert (
        "it may have taken effect; check with: jbclog read dde-1 selected_temperature --port 1"
        " --line" in ended.err
    )
    assert writes(bench) == ["WST100360"]


def test_a_cable_that_is_out_before_is_no_write(make: Make) -> None:
    bench = make(dde())
    unplugged_at(bench, "dde-1", "RST1")
    ended = refused(bench, "selected_temperature", "360", "--port", "1")
    assert (ended.code, ended.err) == (3, "error: the cable is out\n")
    assert writes(bench) == []


def test_a_setting_that_cannot_be_read_is_not_written(make: Make) -> None:
    bench = make(dde(fault("silence", "command = 'selected_temperature'\nonly = 'read'")))
    ended = refused(bench, "selected_temperature", "360", "--port", "1")
    assert ended.code == 3
    assert "selected_temperature of port 1 cannot be read (no answer within 0." in ended.err
    assert writes(bench) == []


def test_nothing_is_written_to_a_stranger(make: Make) -> None:
    bench = make(dde('model = "NAE"'))
    ended = refused(bench, "status", "stand", "--port", "1")
    assert ended.code == 3
    assert (
        "the line file says family dde, the station says model NAE; nothing was written to it"
        in ended.err
    )
    assert writes(bench) == []


@pytest.mark.parametrize(
    ("value", "which"),
    [("505", "above the station's maximum of 500 °C"), ("85", "below the station's minimum of 90")],
)
def test_what_only_the_station_knows_is_asked_before(make: Make, value: str, which: str) -> None:
    bench = make(dde())
    ended = refused(bench, "selected_temperature", value, "--port", "1")
    assert (ended.code, which in ended.err) == (3, True)
    assert writes(bench) == []


def test_the_temperature_of_sleep_is_held_to_what_the_station_allows(make: Make) -> None:
    bench = make(dde())
    ended = refused(bench, "sleep_temperature", "600", "--port", "1")
    assert (ended.code, "600 °C is above the station's maximum of 500 °C" in ended.err) == (3, True)
    assert writes(bench) == []


# -- nobody watches --------------------------------------------------------------------------------


def test_a_tool_that_is_put_to_work_is_watched_by_nobody(make: Make) -> None:
    bench = make(dde())
    ended = bench.do("write", "dde-1", "status", "working", "--port", "1")
    assert ended.code == 0
    assert ended.err.startswith("note: the tool in port 1 is at work unattended and stays hot.")
    assert STAND in ended.err
    ended = bench.do("write", "dde-1", "selected_temperature", "360", "--port", "1")
    assert "the tool in port 1 is at work unattended" in ended.err
    assert (
        bench.call(ended.err.partition("To let it rest: ")[2]).out
        == "status of port 1: stand, confirmed (working before)\n"
    )
    # a tool that stands is no news
    assert bench.do("write", "dde-1", "selected_temperature", "340", "--port", "1").err == ""


def test_hot_air_rests_by_its_own_words(make: Make) -> None:
    bench = make(station_text("air", "jtse"))
    ended = bench.do("write", "air", "status", "on")
    assert (ended.code, "jbclog write air status cooling --port 1 --line" in ended.err) == (0, True)
    assert bench.call(ended.err.partition("To let it rest: ")[2]).code == 0
    assert writes(bench, "air") == ["WPS100001", "WPS100010"]


def test_a_tool_that_may_be_at_work_is_told_so(make: Make) -> None:
    bench = make(dde())
    unplugged_at(bench, "dde-1", "WPS1")
    ended = refused(bench, "status", "working", "--port", "1")
    assert ended.code == 3
    assert "the tool in port 1 is or may be at work" in ended.err


@pytest.mark.parametrize("how", ["gone", "mismatch", "refused"])
def test_a_tool_that_is_not_known_to_rest_is_exit_5(make: Make, how: str) -> None:
    nak = fault("nak", "command = 'status'\nonly = 'write'\ncode = 3") if how == "refused" else ""
    bench = make(dde(f"{TOOLS}\nsettings = {{ status = 'working' }}\n{nak}"))
    bench.wires["dde-1"].only_acknowledged = "-" if nak else "WPS1"
    if how == "gone":
        unplugged_at(bench, "dde-1", "WPS1")
    ended = refused(bench, "status", "stand", "--port", "1")
    assert ended.code == 5
    assert "at work unattended" in ended.err


def test_a_tool_is_told_to_rest_even_where_its_state_cannot_be_read(make: Make) -> None:
    bench = make(dde(fault("silence", "command = 'status'\nonly = 'read'")))
    assert refused(bench, "status", "stand", "--port", "1").code == 5
    assert writes(bench) == ["WPS100001"]


# -- what is dangerous -----------------------------------------------------------------------------

MEANT = ("--yes-i-mean", "dde-1")


@pytest.mark.parametrize("family", FAMILIES)
def test_nothing_dangerous_is_done_unless_it_is_meant(make: Make, family: str) -> None:
    bench = make(station_text("it", family))
    for command in FAMILIES[family].commands.values():
        if command.dangerous:
            ended = bench.do("write", "it", command.name, *_value_for(command.name))
            assert ended.code == 2, command.name
            assert f"error: {command.name} " in ended.err
            assert ended.err.endswith("--yes-i-mean it\n")
    assert bench.wires["it"].opened == 0


def _value_for(name: str) -> list[str]:
    if name == "store_condition":
        return ["condition 0: air_blow_s 1.0"]
    return {"address": ["7"], "run_condition": ["101"]}.get(
        name, ["300"] if name.startswith(("max", "min")) else []
    )


def test_the_call_that_is_told_does_it(make: Make) -> None:
    bench = make(dde())
    ended = bench.do("write", "dde-1", "maximum_temperature", "450")
    assert ended.err.startswith(
        "error: maximum_temperature moves the highest temperature that can be selected on the whole"
        " station. Nothing sent."
    )
    ended = bench.call(ended.err.partition("To confirm: ")[2].strip())
    assert (ended.code, ended.out) == (
        0,
        "maximum_temperature: 450 °C, confirmed (500 °C before)\n",
    )
    assert writes(bench) == ["WMAT00450"]


@pytest.mark.parametrize("words", [("restart",), ("selected_temperature", "360", "--port", "1")])
def test_another_station_s_name_is_wrong_usage(make: Make, words: tuple[str, ...]) -> None:
    bench = make(dde())
    ended = bench.do("write", "dde-1", *words, "--yes-i-mean", "dde-2")
    assert (ended.code, bench.wires["dde-1"].opened) == (2, 0)
    assert "--yes-i-mean dde-2: must be dde-1, the station to write; nothing sent" in ended.err


def test_all_settings_are_kept_before_anything_is_sent(make: Make, tmp_path: Path) -> None:
    bench = make(dde())
    bench.do("write", "dde-1", "adjust", "-5", "--port", "1")
    bench.do("write", "dde-1", "adjust", "9", "--port", "2", "--tool", "7")
    files_at_write: list[list[Path]] = []
    bench.wires["dde-1"].watch = lambda text: (
        files_at_write.append(list(tmp_path.glob("*.json"))) if text[0] == "W" else None
    )
    ended = bench.do("write", "dde-1", "factory_reset", *MEANT)
    (kept,) = files_at_write[0]
    assert (ended.code, ended.out) == (
        0,
        "factory_reset: sent and acknowledged; it cannot be read back\n",
    )
    assert ended.err.startswith(f"note: 86 settings of dde-1 saved in {kept.name}\n")
    told = json.loads(kept.read_text())
    assert (told["station"], told["family"], told["model"], told["before"]) == (
        "dde-1",
        "dde",
        "DDE",
        "factory_reset",
    )
    values = {(one["setting"], one["port"], one["tool"]): one["value"] for one in told["settings"]}
    assert values["adjust", 1, 2] == "-5"
    assert values["adjust", 2, 7] == "9"  # not connected, and a reset takes it all the same
    assert values["selected_temperature", 2, None] == "350"
    assert values["maximum_temperature", None, None] == "500"
    assert values["status", 1, None] == "extractor"
    assert values["sleep_delay", 2, 1] == "5"
    assert writes(bench)[-1] == "WRSP00000"
    assert bench.do("read", "dde-1", "adjust", "--port", "1").out == "0 °C\n"


def test_two_snapshots_of_one_second_have_two_names(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make(dde())
    monkeypatch.setattr(connection, "utc_of", lambda moment, access: "2026-11-21T01:30:00.000000Z")
    for _ in range(3):
        assert bench.do("write", "dde-1", "store", *MEANT).code == 0
    stem = "dde-1-settings-20261121T013000Z"
    assert sorted(path.name for path in tmp_path.glob("*.json")) == [
        f"{stem}-2.json",
        f"{stem}-3.json",
        f"{stem}.json",
    ]


def test_an_order_that_the_station_wants_in_another_form_is_not_tried_in_it(make: Make) -> None:
    bench = make(ale("quirks = ['no_data_orders']"))
    ended = bench.do("write", "ale-1", "start_feeding", "--yes-i-mean", "ale-1")
    assert ended.code == 3
    assert "is not tried in a second form: give it at the station" in ended.err
    assert writes(bench, "ale-1") == ["WSTR00000"]


def test_where_there_is_no_tool_none_is_said_to_be_at_work(make: Make) -> None:
    ended = make(dde("tools = { 1 = 2, 2 = 0 }")).do(
        "write", "dde-1", "status", "working", "--port", "2"
    )
    assert "no tool in port 2: a tool that is inserted heats at once" in ended.err
    assert "the tool in port 2 is at work" not in ended.err


def test_a_state_that_led_on_to_another_is_explained(make: Make) -> None:
    ended = make(station_text("air", "jtse")).do("write", "air", "status", "cooling", "--port", "1")
    assert (ended.code, ended.out.partition(" (")[0]) == (0, "status of port 1: off, confirmed")
    assert "ordered cooling, read back off: the tool has already cooled down" in ended.err


def test_a_snapshot_is_put_where_one_wants_it_and_over_nothing(make: Make, tmp_path: Path) -> None:
    bench = make(dde())
    assert bench.do("write", "dde-1", "store", *MEANT, "--snapshot", "kept.json").code == 0
    before = (tmp_path / "kept.json").read_bytes()
    bench.wires["dde-1"].opened = 0
    ended = bench.do("write", "dde-1", "store", *MEANT, "--snapshot", "kept.json")
    assert (ended.code, bench.wires["dde-1"].opened) == (2, 0)
    assert "--snapshot kept.json: exists; nothing sent" in ended.err
    ended = bench.do("write", "dde-1", "store", *MEANT, "--snapshot", "no-such-folder/kept.json")
    assert (ended.code, "the snapshot cannot be saved" in ended.err) == (4, True)
    assert (tmp_path / "kept.json").read_bytes() == before
    assert writes(bench) == ["WNVS00000"]


def test_without_a_whole_snapshot_nothing_is_sent(make: Make, tmp_path: Path) -> None:
    bench = make(dde(fault("silence", "command = 'sleep_temperature'\nport = 2")))
    ended = refused(bench, "store", *MEANT)
    assert ended.code == 3
    assert "sleep_temperature of port 2, tool 2 cannot be read (no answer within 0." in ended.err
    assert "there is no whole snapshot of the settings; nothing was written" in ended.err
    assert writes(bench) == []
    assert list(tmp_path.glob("*.json")) == []


def test_what_the_station_does_not_have_belongs_to_no_snapshot(make: Make) -> None:
    bench = make(dde(fault("nak", "command = 'alarm_low_delay'\ncode = 4")))
    assert bench.do("write", "dde-1", "store", *MEANT, "--snapshot", "kept.json").code == 0
    told = json.loads(Path("kept.json").read_text())
    assert told["absent"] == ["alarm_low_delay of port 1", "alarm_low_delay of port 2"]


@pytest.mark.parametrize("command", ["restart", "factory_reset"])
def test_a_hot_tool_keeps_a_station_from_being_restarted(make: Make, command: str) -> None:
    bench = make(dde())
    bench.do("write", "dde-1", "status", "working", "--port", "2")
    bench.wait(20)
    ended = refused(bench, command, *MEANT)
    assert ended.code == 3
    assert "dde-1: port 2 is at 3" in ended.err
    assert (
        "only when all tools are at 60 °C or below. Put it to stand, or take the tool out, and wait"
        in ended.err
    )
    assert writes(bench) == ["WPS200000"]


@pytest.mark.parametrize(
    "sim",
    [
        fault("silence", "command = 'tip_temperature'\nport = 2"),
        fault("nak", "command = 'tip_temperature'\nport = 2\ncode = 4"),
    ],
)
def test_a_tip_that_tells_no_temperature_counts_as_hot(make: Make, sim: str) -> None:
    bench = make(dde(sim))
    ended = refused(bench, "restart", *MEANT)
    assert (
        ended.code,
        "port 2 counts as hot, because its temperature cannot be read" in ended.err,
    ) == (
        3,
        True,
    )
    assert writes(bench) == []


def test_a_port_without_a_tool_is_cold(make: Make) -> None:
    bench = make(
        dde(
            "tools = { 1 = 2, 2 = 0 }\n"
            + fault("nak", "command = 'tip_temperature'\nport = 2\ncode = 4")
        )
    )
    assert bench.do("write", "dde-1", "restart", *MEANT).code == 0


def test_a_restart_is_waited_for(make: Make) -> None:
    bench = make(dde())
    bench.do("write", "dde-1", "selected_temperature", "300", "--port", "1")
    ended = bench.do("write", "dde-1", "restart", *MEANT)
    assert ended.code == 0
    assert ended.out.startswith("restart: sent; the station answered again after ")
    assert "volatile settings are lost" in ended.err
    assert writes(bench) == ["WST100300", "WRST00000"]
    assert bench.do("read", "dde-1", "selected_temperature", "--port", "1").out == "350 °C\n"


def test_a_station_that_does_not_come_back_is_said(make: Make) -> None:
    bench = make(dde(fault("silence", "at_s = 5")))
    bench.do("read", "dde-1", "model")  # from here on faults count their seconds
    bench.wait(4)
    bench.wires["dde-1"].watch = lambda text: bench.wait(5) if text == "WRST00000" else None
    ended = refused(bench, "restart", *MEANT)
    assert ended.code == 3
    assert "restart: sent, not confirmed: no answer within 30 s of the restart" in ended.err
    assert writes(bench) == ["WRST00000"]


def test_a_station_that_answers_otherwise_after_a_reset_is_said(make: Make) -> None:
    bench = make(dde(fault("nak", "command = 'model'\nat_s = 5\ncode = 5")))
    bench.do("read", "dde-1", "model")
    bench.wires["dde-1"].watch = lambda text: bench.wait(5) if text == "WRSP00000" else None
    ended = bench.do("write", "dde-1", "factory_reset", *MEANT)
    assert ended.code == 0  # it was done
    assert (
        "sent and acknowledged; the station no longer answers as before (refused with N 00005,"
        " Robot mode is off)" in ended.out
    )


@pytest.mark.parametrize("by_s", [0.7, 1.9])
def test_an_address_that_takes_its_time_is_proven_too(make: Make, by_s: float) -> None:
    late = fault("late", f"only = 'write'\nby_s = {by_s}")
    ended = make(station_text("ucr-1", "ucr", sim=late)).do(
        "write", "ucr-1", "address", "9", "--yes-i-mean", "ucr-1"
    )
    assert (ended.code, ended.out) == (0, "address: 9, confirmed\n")


@pytest.mark.parametrize(("value", "written"), [("7", "address = 7"), ("0", "address = false")])
def test_another_address_is_proven_and_the_line_file_s_turn(
    make: Make, value: str, written: str
) -> None:
    bench = make(station_text("ucr-1", "ucr", "address = 1"))
    ended = bench.do("write", "ucr-1", "address", value, "--yes-i-mean", "ucr-1")
    assert (ended.code, ended.out) == (0, f"address: {value}, confirmed\n")
    assert f"set `{written}` for ucr-1 in" in ended.err
    assert writes(bench, "ucr-1") == [f"WSAD{int(value):05d}"]
    assert bench.do("read", "ucr-1", "model").code == 3
    bench.line.write_text(bench.line.read_text().replace("address = 1", written))
    assert bench.do("read", "ucr-1", "model").out == "UCR245\n"


def test_the_feeder_is_started_once_and_told_how_to_be_stopped(make: Make) -> None:
    bench = make(ale("settings = { feeder_mode = 'continuous' }"))
    ended = bench.do("write", "ale-1", "start_feeding", "--yes-i-mean", "ale-1")
    assert (ended.code, ended.out) == (0, "start_feeding: running, confirmed\n")
    assert (
        "note: the feeder is running unattended. To stop it: jbclog write ale-1 stop_feeding --line"
        in ended.err
    )
    ended = bench.call(ended.err.partition("To stop it: ")[2])
    assert (ended.code, ended.out) == (0, "stop_feeding: stopped, confirmed\n")
    assert writes(bench, "ale-1") == ["WSTR00000", "WSTP00000"]


def test_a_start_whose_answers_are_lost_is_not_sent_again(make: Make) -> None:
    bench = make(
        ale(
            "settings = { feeder_mode = 'continuous' }\n"
            + fault("silence", "command = 'start_feeding'")
        )
    )
    # it is seen to run
    assert bench.do("write", "ale-1", "start_feeding", "--yes-i-mean", "ale-1").code == 0
    unplugged_at(bench, "ale-1", "WSTR")
    ended = bench.do(
        "write", "ale-1", "start_feeding", "--yes-i-mean", "ale-1", "--snapshot", "other.json"
    )
    assert ended.code == 3
    assert "the feeder is or may be running unattended" in ended.err
    assert writes(bench, "ale-1") == ["WSTR00000", "WSTR00000"]


def test_a_feeder_that_does_not_stop_is_exit_5(make: Make) -> None:
    bench = make(ale("settings = { feeder_mode = 'continuous' }"))
    bench.do("write", "ale-1", "start_feeding", "--yes-i-mean", "ale-1")
    bench.wires["ale-1"].only_acknowledged = "WSTP"
    ended = bench.do("write", "ale-1", "stop_feeding")
    assert (ended.code, "stop_feeding: feeding is running" in ended.err) == (5, True)


def test_a_solder_condition_is_kept_written_and_read_back(make: Make) -> None:
    bench = make(station_text("omega-1", "omega"))
    shown = bench.do("read", "omega-1", "condition", "--condition", "101").out.strip()
    changed = shown.replace("preheat_s ", "preheat_s 1")
    meant = ("--yes-i-mean", "omega-1", "--snapshot", "kept.json")
    ended = bench.do("write", "omega-1", "store_condition", changed, *meant)
    assert (ended.code, ended.out) == (
        0,
        f"store_condition: {changed}, confirmed ({shown} before)\n",
    )
    assert "note: only solder condition 101 of omega-1 saved in kept.json" in ended.err
    told = json.loads(Path("kept.json").read_text())
    assert [(one["setting"], one["condition"], one["value"]) for one in told["settings"]] == [
        ("condition", 101, shown)
    ]
    assert len(writes(bench, "omega-1")) == 1


def test_a_long_wait_is_told_before_it_begins(make: Make) -> None:
    ended = make(station_text("omega-1", "omega")).do(
        "write", "omega-1", "run_condition", "101", "--yes-i-mean", "omega-1"
    )
    assert ended.err.startswith(
        "note: waiting up to 120 s: the controller answers when the joint is done\n"
    )


# -- interrupted, and held by a run ----------------------------------------------------------------


@pytest.mark.parametrize(("at", "is_told"), [("RST1", False), ("WST1", True)])
def test_ctrl_c_says_whether_it_was_sent(make: Make, at: str, is_told: bool) -> None:
    bench = make(dde())

    def watch(text: str) -> None:
        if text.startswith(at):
            raise KeyboardInterrupt

    bench.wires["dde-1"].watch = watch
    ended = refused(bench, "selected_temperature", "360", "--port", "1")
    assert ended.code == 130
    assert ("interrupted after the write was sent, before it was read back" in ended.err) is is_told
    assert ("sent, not confirmed" in ended.err) is is_told


@pytest.mark.parametrize(
    "words",
    [
        ("read", "dde-1", "model"),
        ("write", "dde-1", "status", "stand", "-p", "1"),
        ("read", "dde-1", "--all"),
    ],
)
def test_a_run_that_holds_the_station_is_named(
    make: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, words: tuple[str, ...]
) -> None:
    bench = make(dde())
    monkeypatch.setattr(
        connection, "run_that_holds", lambda url: tmp_path / "runs" / "20261121T013000Z-hand-k7qd"
    )
    ended = bench.do(*words)
    assert (ended.code, ended.out, bench.wires["dde-1"].opened) == (3, "", 0)
    assert (
        ended.err
        == "error: dde-1: the run runs/20261121T013000Z-hand-k7qd holds this station; nothing was"
        " sent. End that run, or wait for its end\n"
    )


@pytest.mark.parametrize(
    ("run", "told"),
    [("runs/x", "dde-1: the run runs/x holds this station"), (None, "in use by process 4711")],
)
def test_a_port_that_is_in_use_names_the_run_of_whoever_has_it(
    make: Make, monkeypatch: pytest.MonkeyPatch, run: str | None, told: str
) -> None:
    """A run that begins just now may have the port before its record can be seen."""
    bench = make(dde())

    def busy(url: str, line: LineFormat) -> Port:
        raise PortBusy(f"{url} is in use by process 4711 (jbclog)", 4711)

    bench.access = replace(bench.access, open_port=busy)
    monkeypatch.setattr(
        connection, "run_of", lambda process: Path.cwd() / run if run and process == 4711 else None
    )
    ended = bench.do("read", "dde-1", "model")
    assert (ended.code, told in ended.err) == (3, True)


# -- what is wrong is said before anything is sent -------------------------------------------------


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ("selected_temperature", "360"),
            "selected_temperature belongs to a port: name it with --port, one of 1, 2",
        ),
        (
            ("selected_temperature", "362", "-p", "1"),
            "362 °C is not allowed; steps of 5 °C, within what the station itself allows",
        ),
        (("selected_temperature", "hot", "-p", "1"), "'hot' is not a number; steps of 5 °C"),
        (("selected_temperature", "12,5", "-p", "1"), "write the decimal point as a dot"),
        (("selected_temperature", "3_50", "-p", "1"), "'3_50' is not a number"),
        (("selected_temperature", "٣٥٠", "-p", "1"), "'٣٥٠' is not a number"),
        (("selected_temperature", "off", "-p", "1"), "'off' is not a number"),
        (("selected_temperature", "1e3", "-p", "1"), "'1e3' is not a number"),
        (("selected_temperature", "350.5", "-p", "1"), "350.5 °C is not allowed"),
        (("selected_temperature", "-p", "1"), "selected_temperature needs a value"),
        (("selected_temperature", "350", "-p", "3"), "there is no port 3; this station has 1, 2"),
        (("adjust", "-55", "-p", "1"), "-55 °C is not allowed; -50 to 50 °C, in steps of 1"),
        (("sleep_temperature", "100000", "-p", "1"), "100000 does not fit in five characters"),
        (
            ("alarm_high_limit", "700", "-p", "1"),
            "700 °C would be read back as not set; 1 to 600 °C",
        ),
        (
            ("sleep_delay", "10", "-p", "1"),
            '10 min is not allowed; 0 to 9 min, in steps of 1, or "off"',
        ),
        (
            ("alarm_high_limit", "off", "-p", "1"),
            "no manual prints how to clear a limit; switch its delay off instead",
        ),
        (("alarm_high_delay", "1.605", "-p", "1"), "1.605 s is not allowed"),
        (("status", "cooling", "-p", "1"), "status: must be one of working, stand, extractor"),
        (("status", "00001", "-p", "1"), " (got '00001')"),
        (("tip_temperature", "5"), "tip_temperature can only be read: `jbclog read` does that"),
        (("restart", "0"), "restart takes no value: omit '0'"),
        (("selected_temprature", "5"), "did you mean selected_temperature, sleep_temperature?"),
        (("feeder_mode", "foo"), "a station of family dde has no 'feeder_mode'"),
        (
            ("status", "stand", "-p", "1", "--tool", "1"),
            "status belongs to no tool: omit --tool",
        ),
    ],
)
def test_wrong_usage_is_said_before_anything_is_sent(
    make: Make, words: tuple[str, ...], told: str
) -> None:
    bench = make(dde())
    ended = bench.do("write", "dde-1", *words)
    assert (ended.code, ended.out) == (2, "")
    assert told in ended.err
    assert bench.wires["dde-1"].opened == 0


@pytest.mark.parametrize(
    ("family", "words", "told"),
    [
        (
            "ale",
            ("feeder_length", "-1"),
            (
                "-1 mm is not within 0 to 9999.9 mm, as far as five digits go; no manual prints a"
                " range"
            ),
        ),
        ("ale", ("feeder_length", "1000000"), "1000000 mm is not within 0 to 9999.9 mm"),
        ("ale", ("feeder_diameter", "1000"), "1000 mm is not within 0 to 999.99 mm"),
        ("ale", ("feeder_length", "7.55"), "7.55 mm is not a multiple of 0.1 mm"),
        (
            "omega",
            ("run_condition", "200"),
            "200 is no number of a solder condition; 101 to 199, 201 to 299 or 301 to 399",
        ),
        (
            "omega",
            ("run_condition", "400"),
            "400 is not allowed; 101 to 199, 201 to 299 or 301 to 399",
        ),
        (
            "omega",
            ("store_condition", "condition 200, mode 5, set_temperature_raw 1, process_raw 1"),
            "200 is no number of a solder condition; 101",
        ),
        (
            "omega",
            ("store_condition", "condition 0, air_blow_s 500"),
            "500.0 is not within 0 to 409.5",
        ),
    ],
)
def test_what_is_wrong_is_told_as_it_was_typed_and_once(
    make: Make, family: str, words: tuple[str, ...], told: str
) -> None:
    ended = make(station_text("x", family)).do("write", "x", "--yes-i-mean", "x", *words)
    assert (ended.code, ended.out) == (2, "")
    assert told in ended.err
    assert ended.err.count("101 to") <= 1


def test_a_family_still_to_be_learnt_is_asked_first(make: Make) -> None:
    bench = make(station_text("x", "auto", sim='model = "UCR245"'))
    assert bench.do("write", "x", "sleep_delay", "10").code == 3
    assert bench.do("write", "x", "feeder_mode", "program").code == 3
    assert bench.do("write", "x", "restart").code == 2  # dangerous wherever there is one
    assert writes(bench, "x") == []
    assert bench.do("write", "x", "selected_temperature", "300").code == 0


def test_without_a_name_the_names_are_listed_with_what_they_take(make: Make) -> None:
    bench = make(ale())
    lines = [" ".join(line.split()) for line in bench.do("write", "ale-1").out.splitlines()]
    assert "restart - station no value; dangerous 002 W-RST; 000 4.7" in lines
    assert (
        "feeder_mode - station continuous, discontinuous, program, reload 002 R-MOD, W-MOD" in lines
    )
    assert not [line for line in lines if line.startswith("tip_temperature")]
    limits = "steps of 5 °C from minimum_temperature to maximum_temperature"
    assert f"selected_temperature °C port {limits} 002 W-STx" in lines


# -- suction, which a status word of hot air orders, too -------------------------------------------


@pytest.mark.parametrize(
    ("before", "word", "sent", "told"),
    [
        (True, "on", "WPS100101", "on with suction, confirmed"),
        (False, "on", "WPS100001", "on, confirmed"),
        (True, "cooling", "WPS100110", "cooling with suction, confirmed"),
        (True, "cooling-suction", "WPS100010", "cooling, confirmed"),
        (False, "cooling+suction", "WPS100110", "cooling with suction, confirmed"),
        (False, "off+suction", "WPS100100", "off with suction, confirmed"),
        (True, "off-suction", "WPS100000", "off, confirmed"),
    ],
)
def test_suction_is_ordered_by_hand_and_otherwise_kept(
    make: Make, before: bool, word: str, sent: str, told: str
) -> None:
    bench = make(station_text("jtse-1", "jtse", sim="tool = 1"))
    station = bench.wires["jtse-1"].station.device.face.station  # type: ignore[union-attr]
    station.suck(on=before)
    station.heater.temperature_c = 200.0  # so that it has something to cool
    ended = bench.do("write", "jtse-1", "status", word)
    assert (ended.code, bench.wires["jtse-1"].writes[-1:]) == (0, [sent])
    assert f"status of port 1: {told}" in ended.out


def test_suction_that_does_not_follow_is_told(make: Make) -> None:
    bench = make(station_text("jtse-1", "jtse", sim="tool = 1"))
    bench.wires["jtse-1"].only_acknowledged = "WPS1"
    ended = bench.do("write", "jtse-1", "status", "off+suction")
    assert (ended.code, "requested off with suction, off was read back" in ended.err) == (5, True)


def test_soldering_stations_have_no_such_words(make: Make) -> None:
    ended = make(station_text("dde-1", "dde")).do(
        "write", "dde-1", "status", "stand+suction", "-p", "1"
    )
    assert (ended.code, "must be one of working, stand, extractor" in ended.err) == (2, True)
    assert "(got 'stand+suction')" in ended.err


def test_extractor_is_read_back_and_that_the_tool_cools_is_not_claimed(make: Make) -> None:
    bench = make(dde(f"{TOOLS}\nsettings = {{ status = 'working' }}\nextractor_cools = false"))
    ended = bench.do("write", "dde-1", "status", "extractor", "--port", "1")
    assert (ended.code, ended.out) == (
        0,
        "status of port 1: extractor, read back (working before)\n",
    )
    assert "may keep heating the tool in port 1" in ended.err
    assert bench.call(ended.err.partition("If it does not cool: ")[2]).out.startswith(
        "status of port 1: stand, confirmed"
    )
