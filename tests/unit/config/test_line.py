"""Line files: what they hold, and that everything wrong with one is told at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from jbclog.config.line import Line, load_line, parse_line
from jbclog.core.errors import Problems
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.family import FAMILIES

PATH = Path("/lines/bench.toml")
HEAD = '[line]\nname = "bench"\n'
STATION = '[[station]]\nname = "dde-1"\nurl = "/dev/ttyUSB0"\nfamily = "dde"\n'


def line(text: str) -> Line:
    return parse_line(text, PATH)


def problems(text: str) -> list[str]:
    with pytest.raises(Problems) as found:
        line(text)
    return [str(problem).removeprefix("/lines/bench.toml") for problem in found.value.problems]


def test_a_station_has_the_documented_defaults() -> None:
    (station,) = line(HEAD + STATION).stations
    assert (station.name, station.url, station.family) == ("dde-1", "/dev/ttyUSB0", "dde")
    assert station.line_format == LineFormat(19200, "8N1")
    assert station.address == 1
    assert station.ports is None
    assert (station.turnaround_ms, station.recipe, station.rated_power_w, station.sim) == (
        None,
        None,
        None,
        None,
    )


def test_an_omega_has_defaults_of_its_own() -> None:
    omega = STATION.replace('"dde"', '"omega"')
    (station,) = line(HEAD + omega).stations
    assert station.line_format == LineFormat(9600, "8N1")
    assert station.address is None
    (station,) = line(HEAD + omega + "baudrate = 19200\naddress = false\n").stations
    assert (station.baudrate, station.address) == (19200, None)
    assert problems(HEAD + omega + "address = 1\n") == [
        ":7: station[1].address: the frames of family omega have no addresses; leave it out"
    ]


def test_everything_that_a_station_can_say() -> None:
    (station,) = line(
        HEAD
        + STATION.replace("/dev/ttyUSB0", "ports/one")
        + 'baudrate = 9600\nformat = "8E1"\naddress = false\nports = [2, 1]\nturnaround_ms = 1.5\n'
        + 'recipe = "../recipes/tht.toml"\nrated_power_w = 130\n[station.sim]\ntools = { 1 = 2, 2 ='
        " 1 }\n" + '[[station.sim.fault]]\nkind = "silence"\nat_s = 5\n'
    ).stations
    assert station.url == "/lines/ports/one"
    assert station.written_url == "ports/one"
    assert station.recipe == Path("/lines/../recipes/tht.toml")
    assert station.line_format == LineFormat(9600, "8E1")
    assert station.address is None
    assert station.ports == (1, 2)
    assert (station.turnaround_ms, station.rated_power_w) == (1.5, 130)
    assert station.sim is not None
    assert station.sim.tools == {1: 2, 2: 1}
    assert [fault.kind for fault in station.sim.fault] == ["silence"]


@pytest.mark.parametrize(
    ("url", "absolute", "is_device", "is_relative"),
    [
        ("/dev/serial/by-id/x", "/dev/serial/by-id/x", True, False),
        ("dde-1", "/lines/dde-1", True, True),
        ("./ports/dde-1", "/lines/ports/dde-1", True, True),
        ("socket://192.168.1.7:4001", "socket://192.168.1.7:4001", False, False),
        ("socket://[::1]:4001", "socket://[::1]:4001", False, False),
        (
            "rfc2217://host:4001?ign_set_control",
            "rfc2217://host:4001?ign_set_control",
            False,
            False,
        ),
        ("hwgrep://0403:6001", "hwgrep://0403:6001", False, False),
        ("COM3", "COM3", False, False),
    ],
)
def test_a_url_is_a_path_or_one_of_pyserials(
    url: str, absolute: str, is_device: bool, is_relative: bool
) -> None:
    (station,) = line(HEAD + STATION.replace("/dev/ttyUSB0", url)).stations
    assert (station.url, station.is_device, station.is_relative) == (
        absolute,
        is_device,
        is_relative,
    )


def test_a_relative_path_is_taken_from_the_line_files_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "line.toml").write_text(
        HEAD + STATION.replace("/dev/ttyUSB0", "one") + 'recipe = "r.toml"\n'
    )
    monkeypatch.chdir(tmp_path)
    found = load_line(Path("sub/line.toml"))
    assert found.stations[0].url == str(tmp_path / "sub" / "one")
    assert found.stations[0].recipe == tmp_path / "sub" / "r.toml"
    assert found.path == Path("sub/line.toml")
    assert found.text.encode() == (tmp_path / "sub" / "line.toml").read_bytes()


def test_stations_are_found_by_name_and_cannot_be_changed() -> None:
    found = line(HEAD + STATION + STATION.replace("dde-1", "dde-2").replace("USB0", "USB1"))
    assert found.station("dde-2").url == "/dev/ttyUSB1"
    with pytest.raises(KeyError):
        found.station("dde-3")
    with pytest.raises(ValidationError):
        found.stations[0].url = "x"  # type: ignore[misc]


def test_everything_that_is_wrong_is_told_at_once() -> None:
    text = """[line]
name = "../bench"
place = "hall 2"

[[station]]
name = ".dde"
url = "sockets://x:1"
family = "omega"
baudrate = 19201
format = "7E1"
address = true
ports = [2]

[[station]]
name = "dde-1"
url = "../ttyUSB0"
family = "ddee"
ports = [1, 5]
turnaround_ms = -1
written_url = "x"

[[station]]
name = "dde-1"
url = "socket://host"
family = "dde"
ports = [1, 3]
rated_power_w = 0
[station.sim]
tool = 11

[[station]]
name = "ucr"
ports = [1, 1]
family = "ucr"
recipe = 5
address = 100
"""
    assert problems(text) == [
        (
            ':2: line.name: "../bench" is not allowed; 1 to 64 of the characters A-Z a-z 0-9 . _ -,'
            " the first of them a letter, a digit or _"
        ),
        ":3: line.place: unknown; allowed here: name",
        (
            ':6: station[1].name: ".dde" is not allowed; 1 to 64 of the characters A-Z a-z 0-9 . _'
            " -, the first of them a letter, a digit or _"
        ),
        ':7: station[1].url: the kind of port "sockets" is unknown; did you mean socket?',
        (
            ":9: station[1].baudrate: 19201 is not allowed; one of 1200, 2400, 4800, 9600, 19200,"
            " 38400, 57600, 115200, 230400, 250000, 460800, 500000"
        ),
        ":10: station[1].format: '7E1' is not a line format such as 8N1, 8E1 or 8O2",
        (
            ":11: station[1].address: true is not allowed; 1 to 99, or false for frames without"
            " addresses"
        ),
        ":12: station[1].ports[1]: the family omega has no port 2; it has 1",
        (
            ':16: station[2].url: "../ttyUSB0" is not allowed; a relative path stays below the line'
            " file's folder"
        ),
        ':17: station[2].family: "ddee" is unknown; did you mean dde?',
        ":18: station[2].ports[2]: 5 is not allowed; a list of ports from 1 to 4",
        ":19: station[2].turnaround_ms: -1 is not allowed; milliseconds from 0 to 5000",
        (
            ":20: station[2].written_url: unknown; allowed here: name, url, family, model,"
            " baudrate, format, address, ports, turnaround_ms, recipe, rated_power_w, sim"
        ),
        ':23: station[3].name: "dde-1" is the name of two stations, first in line 15',
        ':24: station[3].url: "socket://host" is not allowed; socket://HOST:PORT',
        ":26: station[3].ports[2]: the family dde has no port 3; it has 1, 2",
        ":27: station[3].rated_power_w: 0 is not allowed; watts, more than 0",
        ":29: station[3].sim.tool: 11 is not allowed; input should be less than or equal to 9",
        ":31: station[4].url: missing; a device path, socket://HOST:PORT or rfc2217://HOST:PORT",
        ":33: station[4].ports: [1, 1] names a port twice",
        (
            ":35: station[4].recipe: 5 is not allowed; a recipe file's path, from the line file's"
            " folder"
        ),
        (
            ":36: station[4].address: 100 is not allowed; 1 to 99, or false for frames without"
            " addresses"
        ),
    ]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (STATION, ': line: missing; a table with the line\'s name: [line] name = "bench-3"'),
        (HEAD, ": station: missing; at least one table [[station]] with name, url and family"),
        (
            HEAD + "[station]\nname = 'x'\n",
            (
                ":3: station: {'name': 'x'} is not allowed; at least one table [[station]] with"
                " name, url and family"
            ),
        ),
        (
            HEAD + STATION.replace('family = "dde"', ""),
            f":3: station[1].family: missing; one of {', '.join(FAMILIES)}, auto",
        ),
        (
            HEAD + STATION.replace('"dde"', '"DDE"'),
            ':6: station[1].family: "DDE" is unknown; did you mean dde?',
        ),
        (
            HEAD + STATION + "ports = []\n",
            ":7: station[1].ports: [] is not allowed; a list of ports from 1 to 4",
        ),
        (
            HEAD + STATION + 'address = "1"\n',
            (
                ':7: station[1].address: "1" is not allowed; 1 to 99, or false for frames without'
                " addresses"
            ),
        ),
        (
            HEAD + STATION + "address = 0\n",
            (
                ":7: station[1].address: 0 is not allowed; 1 to 99, or false for frames without"
                " addresses"
            ),
        ),
        (HEAD + STATION.replace("dde-1", "a\\nb"), None),
        (HEAD + STATION.replace("dde-1", "a\\u001b[2J"), None),
        (HEAD + STATION.replace("dde-1", "a" * 65), None),
        (HEAD + STATION.replace("dde-1", "-rf"), None),
        (HEAD + STATION.replace("dde-1", ""), None),
        (HEAD + STATION.replace("dde-1", "é"), None),
    ],
)
def test_one_thing_wrong(text: str, problem: str | None) -> None:
    told = problems(text)
    assert "\x1b" not in "".join(told)
    if problem is None:
        assert all(one.startswith(":4: station[1].name: ") for one in told)
    else:
        assert told == [problem]


def test_two_names_of_one_device_are_one_port(tmp_path: Path) -> None:
    (tmp_path / "ttyUSB0").touch()
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyUSB0")
    text = (
        HEAD
        + STATION.replace("/dev/ttyUSB0", "ttyUSB0")
        + STATION.replace("dde-1", "dde-2").replace("/dev/ttyUSB0", "by-id")
    )
    with pytest.raises(Problems) as found:
        parse_line(text, tmp_path / "line.toml")
    (problem,) = found.value.problems
    assert (problem.line, problem.key) == (9, "station[2].url")
    assert problem.text.startswith(
        '"by-id" is the port of two stations, first in line 5; the manuals print RS-232, which is'
        " point"
    )
    assert problem.text.endswith(
        "Connect the other station to a port or an adapter of its own, and name that"
    )


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("socket://a:1", "socket://a:1"),
        ("socket://a:1", "rfc2217://A:1?ign_set_control"),
        ("socket://localhost:1", "socket://127.0.0.1:1"),
        ("/dev/ttyUSB0", "/dev//ttyUSB0"),
    ],
)
def test_two_stations_on_one_line_are_refused_with_why_and_what_to_do(one: str, other: str) -> None:
    """Two addresses do not make a bus of it."""
    first = STATION.replace("/dev/ttyUSB0", one)
    second = STATION.replace("dde-1", "dde-2").replace("/dev/ttyUSB0", other) + "address = 2\n"
    (problem,) = problems(HEAD + first + second)
    assert (
        problem
        == f':9: station[2].url: "{other}" is the port of two stations, first in line 5; the'
        " manuals print RS-232, which is point to point: one port and one station, whatever"
        " their addresses. Connect the other station to a port or an adapter of its own, and"
        " name that"
    )


def test_two_ports_of_one_server_are_two_lines() -> None:
    first = STATION.replace("/dev/ttyUSB0", "socket://a:1")
    line = parse_line(
        HEAD + first + STATION.replace("dde-1", "dde-2").replace("/dev/ttyUSB0", "socket://a:2"),
        Path("line.toml"),
    )
    assert [station.url for station in line.stations] == ["socket://a:1", "socket://a:2"]


# -- a model name that is accepted -----------------------------------------------------------------


def test_a_station_may_name_the_model_that_it_is_driven_under() -> None:
    (station,) = line(HEAD + STATION + 'model = "  DIE"\n').stations
    assert (station.family, station.model) == ("dde", "DIE")
    (station,) = line(HEAD + STATION.replace('"dde"', '"hde"') + 'model = "DME"\n').stations
    assert (station.family, station.model) == ("hde", "DME")


@pytest.mark.parametrize(
    ("family", "model", "told"),
    [
        (
            "dde",
            "JTQE",
            (
                '"JTQE" begins with JT: it is a hot air station, which status 00001 switches on,'
                " and no dde"
            ),
        ),
        (
            "soldering",
            "jtse",
            (
                '"jtse" begins with JT: it is a hot air station, which status 00001 switches on,'
                " and no soldering"
            ),
        ),
        (
            "jtse",
            "DIE",
            (
                '"DIE" does not begin with JT, as the model names of hot air stations do: it is no'
                " jtse"
            ),
        ),
        (
            "jtse",
            "DDE",
            (
                '"DDE" does not begin with JT, as the model names of hot air stations do: it is no'
                " jtse"
            ),
        ),
        ("omega", "DIE", "a station of family omega reports no model; leave it out"),
        ("auto", "DIE", 'is driven as a family says: name that family in place of "auto"'),
        (
            "dde",
            "",
            '"" is not allowed; 1 to 16 printable characters, as the station gives its model',
        ),
        (
            "dde",
            "DÏE",
            '"DÏE" is not allowed; 1 to 16 printable characters, as the station gives its model',
        ),
    ],
)
def test_a_model_name_that_cannot_be_driven_so_is_told(family: str, model: str, told: str) -> None:
    assert problems(HEAD + STATION.replace('"dde"', f'"{family}"') + f'model = "{model}"\n') == [
        f":7: station[1].model: {told}"
    ]
