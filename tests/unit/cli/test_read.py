"""`jbclog read`: what it prints, what it asks, and what it refuses before it has asked anything."""

from __future__ import annotations

import json
import re

import pytest

from jbclog.app import connection
from jbclog.core.errors import WriteForbidden
from jbclog.protocol.commands.family import FAMILIES
from jbclog.session.manual.contact import open_contact
from support.invoked import invoked
from support.oracles.printed_omega import PageOmega
from support.virtual.manual import Make, station_text

TOOLS = "tools = { 1 = 2, 2 = 1 }"


def dde(sim: str = TOOLS, keys: str = "") -> str:
    return station_text("dde-1", "dde", keys, sim)


# -- values ----------------------------------------------------------------------------------------


def test_a_value_is_told_with_its_unit(make: Make) -> None:
    ended = make(dde()).do("read", "dde-1", "selected_temperature", "--port", "2")
    assert (ended.code, ended.out, ended.err) == (0, "350 °C\n", "")


def test_without_a_port_every_port_is_read(make: Make) -> None:
    assert (
        make(dde()).do("read", "dde-1", "selected_temperature").out
        == "port 1: 350 °C\nport 2: 350 °C\n"
    )
    assert (
        make(dde("", "ports = [2]")).do("read", "dde-1", "selected_temperature").out
        == "port 2: 350 °C\n"
    )


def test_ports_that_no_manual_counts_are_those_that_answer(make: Make) -> None:
    bench = make(station_text("old", "soldering", "ports = [1, 2, 3]"))
    bench.line.write_text(bench.line.read_text().replace("ports = [1, 2, 3]", ""))
    assert bench.do("read", "old", "power").out == "port 1: 0 ‰\nport 2: 0 ‰\nport 3: 0 ‰\n"
    assert bench.do("read", "old", "power", "--port", "4").code == 3


def test_what_belongs_to_a_tool_is_read_of_the_one_connected(make: Make) -> None:
    bench = make(dde())
    assert bench.do("read", "dde-1", "adjust").out == "port 1, tool 2: 0 °C\nport 2, tool 1: 0 °C\n"
    assert bench.do("read", "dde-1", "adjust", "--port", "1", "--tool", "5").out == "0 °C\n"
    assert [text for text in bench.wires["dde-1"].texts if text.startswith("RA")] == [
        "RA12",
        "RA12",
        "RA21",
        "RA21",
        "RA15",
        "RA15",
    ]


def test_without_a_tool_one_must_be_named(make: Make) -> None:
    ended = make(dde("tool = 0")).do("read", "dde-1", "adjust", "--port", "1")
    assert ended.code == 3
    assert "there is none in port 1; name one with --tool, such as --tool 1 (T210)" in ended.err


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("model", "DDE"),
        ("tool", "2: T245/T470/TR245/TR470"),
        ("port_error", "0: ok"),
        ("station_error", "0: ok"),
        ("status", "extractor"),
        ("alarm_high_limit", "not set"),
        ("alarm_high_delay", "off"),
        ("sleep_delay", "5 min"),
        ("time_to_sleep", "not counting (99999)"),
        ("plugged_hours", "1234 h"),
        ("sleep_cycles", "7"),
    ],
)
def test_numbers_that_stand_for_something_are_told_in_words(
    make: Make, name: str, text: str
) -> None:
    bench = make(dde(f"{TOOLS}\ncounters = {{ plugged_hours = 1234.5, sleep_cycles = 7 }}"))
    station_wide = FAMILIES["dde"].commands[name].scope.value == "station"
    assert (
        bench.do("read", "dde-1", name, *([] if station_wide else ["--port", "1"])).out
        == f"{text}\n"
    )


def test_what_means_nothing_without_a_thermocouple_is_not_known(make: Make) -> None:
    bench = make(station_text("jtse-1", "jtse", sim="thermocouple = false"))
    ended = bench.do("read", "jtse-1", "external_temperature")
    assert (ended.code, ended.out, ended.err) == (
        0,
        "port 1: not known: no thermocouple (port error 4)\n",
        "",
    )
    facts = json.loads(
        bench.do("read", "jtse-1", "external_temperature", "--port", "1", "--json").out
    )
    assert (facts["value"], facts["reason"]) == (None, "no_thermocouple")
    everything = bench.do("read", "jtse-1", "--all")
    assert everything.code == 0
    assert re.search(
        r"^external_temperature of port 1 +not known: no thermocouple", everything.out, re.MULTILINE
    )


@pytest.mark.parametrize("name", ["tip_temperature", "power", "time_to_sleep"])
def test_what_means_nothing_without_a_tool_is_not_known(make: Make, name: str) -> None:
    bench = make(dde("tools = { 1 = 2, 2 = 0 }"))
    ended = bench.do("read", "dde-1", name)
    assert ended.code == 0
    assert "port 2: not known: no tool (port error 4)" in ended.out
    assert "port 1: not known" not in ended.out
    facts = json.loads(bench.do("read", "dde-1", name, "--port", "2", "--json").out)
    assert (facts["value"], facts["reason"]) == (None, "no_tool")


def test_an_omega_s_condition_is_read_by_its_number(make: Make) -> None:
    bench = make(station_text("omega-1", "omega"))
    assert bench.do("read", "omega-1", "information").out == "normal\n"
    assert bench.do("read", "omega-1", "condition", "--condition", "101").out.startswith(
        "condition 101: mode 0, rise_s "
    )
    assert (
        "needs --condition with a number: 101 to 199"
        in bench.do("read", "omega-1", "condition").err
    )
    assert bench.do("read", "omega-1", "condition", "--condition", "200").code == 2


# -- json ------------------------------------------------------------------------------------------


def test_one_value_as_json(make: Make) -> None:
    told = json.loads(make(dde()).do("read", "dde-1", "adjust", "--port", "1", "--json").out)
    time = told.pop("time")
    assert told == {
        "station": "dde-1",
        "command": "adjust",
        "port": 1,
        "tool": 2,
        "value": 0,
        "uom": "°C",
        "text": "0 °C",
        "raw": "00000",
        "manual": "002 W-Axy",
    }
    assert time.endswith("Z")
    assert len(time) == len("2026-11-21T01:30:00.000000Z")


@pytest.mark.parametrize(
    ("words", "values"),
    [
        (("power",), [0, 0]),
        (("status",), ["extractor", "extractor"]),
        (("alarm_high_delay",), ["off", "off"]),
    ],
)
def test_several_values_as_json_are_one_object(
    make: Make, words: tuple[str, ...], values: list[object]
) -> None:
    told = json.loads(make(dde()).do("read", "dde-1", *words, "--json").out)
    assert told["station"] == "dde-1"
    assert [one["value"] for one in told["values"]] == values
    assert [one["port"] for one in told["values"]] == [1, 2]


def test_a_value_of_the_whole_station_is_one_object(make: Make) -> None:
    told = json.loads(make(dde()).do("read", "dde-1", "model", "--json").out)
    assert (told["value"], told["raw"], told["port"]) == ("DDE", "  DDE", None)


# -- everything ------------------------------------------------------------------------------------


def test_all_of_it_leaves_alone_what_reading_clears(make: Make) -> None:
    bench = make(dde())
    ended = bench.do("read", "dde-1", "--all")
    assert ended.code == 0
    assert "tip_temperature of port 2 " in ended.out
    assert "adjust of port 2, tool 1 " in ended.out
    assert not [text for text in bench.wires["dde-1"].texts if text.startswith("RTA")]
    assert ended.err == "note: read these by name: alarm_flags (reading clears it)\n"


def test_reading_alarm_flags_clears_them_and_says_so(make: Make) -> None:
    alarm = 'alarm_high_limit = 100, alarm_high_delay = 0.0, status = "working"'
    fault = "[[station.sim.fault]]\nkind = 'overheat'\nport = 1\nby_c = 50\nfor_s = 30"
    bench = make(dde(f"{TOOLS}\nsettings = {{ {alarm} }}\n{fault}"))
    bench.do("read", "dde-1", "model")
    bench.wait(40)
    ended = bench.do("read", "dde-1", "alarm_flags", "--port", "1")
    assert ended.out == "high\n"
    assert ended.err == "note: reading alarm_flags cleared it in the station\n"
    # once: it is never asked twice
    assert [text for text in bench.wires["dde-1"].texts if text.startswith("RTA")] == ["RTA1"]


def test_what_the_station_does_not_know_is_no_failure_of_all(make: Make) -> None:
    bench = make(
        dde("[[station.sim.fault]]\nkind = 'nak'\ncommand = 'transformer_temperature'\ncode = 4")
    )
    ended = bench.do("read", "dde-1", "--all")
    assert ended.code == 0
    assert "unknown to this station (N 00004)" in ended.out
    assert bench.do("read", "dde-1", "transformer_temperature").code == 3


# -- what does not come ----------------------------------------------------------------------------

SILENT = "[[station.sim.fault]]\nkind = 'silence'\ncommand = 'power'\nport = 2"


def test_a_port_that_does_not_tell_hides_no_other(make: Make) -> None:
    bench = make(dde(SILENT))
    ended = bench.do("read", "dde-1", "power")
    assert (ended.code, ended.out) == (3, "port 1: 0 ‰\n")
    assert ended.err.startswith("error: dde-1: power of port 2: no answer within 0.")
    told = json.loads(bench.do("read", "dde-1", "power", "--json").out)
    assert [(one["value"], one.get("reason")) for one in told["values"]] == [
        (0, None),
        (None, "timeout"),
    ]
    ended = bench.do("read", "dde-1", "--all")
    assert (
        ended.code,
        "power of port 2                           not read: no answer" in ended.out,
    ) == (3, True)


def test_robot_mode_off_is_said(make: Make) -> None:
    ended = make(dde("robot_mode = false")).do("read", "dde-1", "model")
    assert (ended.code, ended.err) == (
        3,
        "error: dde-1: Robot mode is off; switch it on in the station's menu\n",
    )


def test_nobody_there_says_what_to_look_at(make: Make) -> None:
    ended = make(dde("[[station.sim.fault]]\nkind = 'silence'")).do("read", "dde-1", "model")
    assert ended.code == 3
    assert "no usable answer on" in ended.err
    assert (
        "check that the station is on, Robot mode is switched on in its menu, the cable, and the"
        " line format" in ended.err
    )
    ended = make(
        station_text("omega-1", "omega", sim="[[station.sim.fault]]\nkind = 'silence'")
    ).do("read", "omega-1", "mode")
    assert ended.code == 3
    assert "Robot mode" not in ended.err


def test_a_stranger_is_read_with_a_note(make: Make) -> None:
    ended = make(dde('model = "NAE"')).do("read", "dde-1", "station_error")
    assert (ended.code, ended.out) == (0, "0: ok\n")
    assert (
        "the line file says family dde, the station says model NAE; read by the tables of dde"
        in ended.err
    )


def test_the_family_may_be_learnt(make: Make) -> None:
    bench = make(station_text("x", "auto", sim='model = "UCR245"'))
    assert bench.do("read", "x", "fuse").out == "present\n"
    assert (
        bench.do("read", "x", "feeder_mode").err
        == "error: x is a UCR245: a station of family ucr has no 'feeder_mode'. Omit the name to"
        " list all\n"
    )
    assert "selected_temperature" in bench.do("read", "x").out


# -- what is wrong is said before anything is sent -------------------------------------------------


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ("dde-1", "tip_temp"),
            "a station of family dde has no 'tip_temp'; did you mean tip_temperature",
        ),
        (
            ("dde-1", "Temp"),
            (
                "a station of family dde has no 'Temp'; did you mean tip_temperature,"
                " transistor_temperature"
            ),
        ),
        (
            ("dde-1", "frobnicate"),
            "a station of family dde has no 'frobnicate'. Omit the name to list all",
        ),
        (("dde-1", "restart"), "restart can only be written: `jbclog write` does that"),
        (("dde-1", "fuse"), "a station of family dde has no 'fuse'"),
        (("dde-1", "model", "--port", "1"), "model belongs to the whole station: omit --port"),
        (("dde-1", "power", "--port", "3"), "there is no port 3; this station has 1, 2"),
        (("dde-1", "power", "--tool", "1"), "power belongs to no tool: omit --tool"),
        (
            ("dde-1", "adjust", "--tool", "0"),
            "no command can address tool 0, only 1 to 9. Manual 002 prints 1 T210; 2 T245",
        ),
        (
            ("dde-1", "power", "--condition", "101"),
            "power belongs to no solder condition: omit --condition",
        ),
        (("dde-1", "--port", "1"), "--port, --tool and --condition require a name"),
        (("dde-1", "--all", "--port", "1"), "--all reads every port and the connected tools"),
        (("dde-1", "power", "--all"), "give 'power' or --all, not both"),
        (
            ("dde-2", "power"),
            "line.toml has no station 'dde-2'; did you mean dde-1? It has dde-1, x",
        ),
        (("x", "frobnicate"), "no station knows 'frobnicate'"),
    ],
)
def test_wrong_usage_is_said_before_anything_is_sent(
    make: Make, words: tuple[str, ...], told: str
) -> None:
    bench = make(dde(), station_text("x", "auto", sim='model = "UCR245"'))
    ended = bench.do("read", *words)
    assert (ended.code, ended.out) == (2, "")
    assert told in ended.err
    assert [wire.opened for wire in bench.wires.values()] == [0, 0]


def test_nothing_but_questions_can_go_out(make: Make) -> None:
    """Whatever the steps wish for: the port itself refuses it."""
    bench = make(dde(), station_text("omega-1", "omega"))
    target = bench.target("dde-1")

    async def steps() -> None:
        contact = await open_contact(target)
        await contact.client.write(contact.family.commands["status"], (0, 0, 0, 0, 1), 1)

    with pytest.raises(WriteForbidden):
        connection.ask(target, steps(), bench.access)
    assert bench.wires["dde-1"].writes == []
    connection.ask(target, steps(), bench.access, may_write=True)
    assert bench.wires["dde-1"].writes == ["WPS100001"]
    assert connection.only_reads_for(FAMILIES["omega"])(b"\x02A\x0341")
    assert not connection.only_reads_for(FAMILIES["omega"])(b"\x02H0065\x0313")


# -- lists -----------------------------------------------------------------------------------------


def test_without_a_name_the_names_are_listed(make: Make) -> None:
    bench = make(dde())
    ended = bench.do("read", "dde-1")
    assert ended.code == 0
    heads, *lines = ended.out.splitlines()
    assert heads.split() == ["name", "uom", "scope", "values", "manual"]
    assert [line.split()[0] for line in lines] == [
        command.name for command in FAMILIES["dde"].commands.values() if command.readable
    ]
    assert "adjust °C tool -50 to 50 °C, in steps of 1 002 W-Axy" in [
        " ".join(line.split()) for line in lines
    ]
    assert "reading clears it" in next(line for line in lines if line.startswith("alarm_flags"))
    assert bench.wires["dde-1"].opened == 0
    told = json.loads(bench.do("read", "dde-1", "--json").out)
    assert (told["family"], len(told["names"])) == ("dde", len(lines))
    assert told["names"][0] == {
        "name": "tip_temperature",
        "uom": "°C",
        "values": "",
        "scope": "port",
        "manual": "002 R-TTx; 000 4.8.3",
        "remark": "",
    }


@pytest.mark.parametrize("verb", ["read", "write"])
def test_help_lists_every_name_of_every_family(verb: str) -> None:
    told = invoked(verb, "--help").stdout.partition("Names")[2]
    words = set(re.findall(r"[a-z_]+", told))
    names = {
        name
        for family in FAMILIES.values()
        for name, command in family.commands.items()
        if (command.readable if verb == "read" else command.writable)
    }
    assert names <= words
    assert set(FAMILIES) <= words
    dangerous = {
        name
        for family in FAMILIES.values()
        for name, command in family.commands.items()
        if command.dangerous
    }
    behind = set(told.partition("Dangerous, require --yes-i-mean STATION:")[2].split())
    assert behind == (dangerous if verb == "write" else set())


def test_all_of_an_omega_that_knows_its_printed_page_only(make: Make) -> None:
    """What is not answered is not there, and no error; a alone is an answer, and tells no state."""
    bench = make(station_text("omega-1", "omega"))
    controller = PageOmega("a")
    # somebody looked for a JBC station: the first A is swallowed
    controller.receive(b"\x02RSMN\x03\x03", 0.0)
    bench.wires["omega-1"].station = controller  # type: ignore[assignment]  # another maker's
    ended = bench.do("read", "omega-1", "--all")
    assert ended.code == 0, ended.err
    told = dict(line.split("  ", 1) for line in ended.out.splitlines())
    assert told["information"].strip() == "not known: answered without a digit"
    assert {
        told[name].strip()
        for name in ("temperature control", "set temperature state", "mode")
        if name in told
    } <= {"unknown to this station (it does not answer it)"}
    assert ended.out.count("it does not answer it") == 3
    (fact,) = [
        one
        for one in json.loads(bench.do("read", "omega-1", "--all", "--json").out)["values"]
        if one["value"] is None
    ][:1]
    assert fact["reason"] == "no_digit"
