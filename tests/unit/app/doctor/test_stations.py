"""A line file held against what its stations say, on virtual wires with real line formats."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.doctor import Fine, Looked, look_at_stations
from jbclog.config.line import parse_line
from jbclog.core.serial_line import LineFormat
from jbclog.session.discovery.scan_plan import ScanFinding
from support.links.uart_ports import Cable, Echo, Silence, access_to, station_cable
from support.oracles.printed_omega import PageOmega

PLACE = Path("/place/line.toml")


def looked_at(
    cable: Cable | None, family: str = "dde", keys: str = "", url: str = "/dev/far"
) -> list[Looked]:
    """What doctor says of one station that the line file describes so, with `cable` at its port."""
    line = parse_line(
        f'[line]\nname = "x"\n[[station]]\nname = "s-1"\nurl = "{url}"\nfamily ='
        f' "{family}"\n{keys}\n',
        PLACE,
    )
    return look_at_stations(
        line, access=access_to({} if cable is None else {line.stations[0].url: cable})
    )


def finding(looked: list[Looked]) -> ScanFinding:
    (one,) = looked
    assert isinstance(one, ScanFinding)
    return one


def test_a_station_as_the_file_says() -> None:
    (one,) = looked_at(station_cable("dde"))
    assert one == Fine(
        "station",
        "s-1",
        "DDE answers at 19200 8N1, address 01 in 1.0 ms; port 1 T245/T470/TR245/TR470; port 2"
        " T245/T470/TR245/TR470; Robot mode is not known until the first write",
    )


@pytest.mark.parametrize(
    "keys", ['baudrate = 1200\nformat = "8O2"', "address = 44", "address = false"]
)
def test_what_the_file_says_is_tried_first_and_found_at_once(keys: str) -> None:
    cable = station_cable("hde", keys)
    (one,) = looked_at(cable, "hde", keys)
    assert isinstance(one, Fine)
    assert cable.opened == 1


def test_an_omega_as_the_file_says() -> None:
    (one,) = looked_at(station_cable("omega"), "omega")
    assert isinstance(one, Fine)
    assert "9600 8N1" in one.what


def test_an_omega_that_knows_its_printed_page_only() -> None:
    (one,) = looked_at(Cable(PageOmega("a"), LineFormat(9600)), "omega")
    assert isinstance(one, Fine)
    assert one.what.endswith("answers at 9600 8N1 in 20.0 ms")


def test_an_omega_that_the_file_calls_something_else() -> None:
    one = finding(
        looked_at(station_cable("omega"), "soldering", "baudrate = 9600\naddress = false")
    )
    assert one.kind == "line.family"
    assert 'family = "omega"' in one.step


@pytest.mark.parametrize(
    ("real", "told"),
    [("9600 8N1", "19200 8N1"), ("19200 8E1", "19200 8N1"), ("19200 8N1", "115200 8E1")],
)
def test_the_right_line_format_is_found_and_named(real: str, told: str) -> None:
    (rate, form), (told_rate, told_form) = real.split(), told.split()
    cable = station_cable("dde", f'baudrate = {rate}\nformat = "{form}"')
    one = finding(looked_at(cable, keys=f'baudrate = {told_rate}\nformat = "{told_form}"'))
    assert one == ScanFinding(
        "line.format",
        "s-1",
        f"it answers at {real}; the line file has {told}",
        f'in {PLACE}, station s-1: set baudrate = {rate}, format = "{form}"',
    )


@pytest.mark.parametrize(
    ("real", "told", "value"),
    [("10", "1", "10"), ("1", "10", "1"), ("false", "1", "false"), ("1", "false", "1")],
)
def test_the_right_address_is_found_and_named(real: str, told: str, value: str) -> None:
    one = finding(looked_at(station_cable("dde", f"address = {real}"), keys=f"address = {told}"))
    assert one.kind == "line.address"
    assert one.step == f"in {PLACE}, station s-1: set address = {value}"


def test_another_family() -> None:
    one = finding(looked_at(station_cable("ale"), "ucr"))
    assert one.kind == "line.family"
    assert "the line file has family ucr; the station is ALE" in one.what


def test_a_model_that_the_file_accepts_is_fine_and_another_is_not() -> None:
    (one,) = looked_at(station_cable("dde", sim='model = "DIE"'), "dde", 'model = "DIE"')
    assert isinstance(one, Fine)
    assert one.what.startswith("DIE answers at 19200 8N1")
    other = finding(looked_at(station_cable("dde", sim='model = "NAE"'), "dde", 'model = "DIE"'))
    assert other.kind == "line.model"
    assert other.what == "the line file accepts model DIE; the station reports NAE"
    unknown = finding(looked_at(station_cable("dde", sim='model = "DIE"'), "dde"))
    assert unknown.step.endswith('add model = "DIE"')


def test_auto_takes_any_family() -> None:
    (one,) = looked_at(station_cable("ale"), "auto")
    assert isinstance(one, Fine)


def test_ports_without_a_tool() -> None:
    one = finding(looked_at(station_cable("dde", sim="tools = { 2 = 0 }")))
    assert one.kind == "tool.missing"
    assert one.step == f"insert a tool, or in {PLACE}, station s-1: set ports = [1]"


def test_ports_without_a_tool_that_the_file_does_not_name_are_no_matter() -> None:
    (one,) = looked_at(station_cable("dde", sim="tools = { 2 = 0 }"), keys="ports = [1]")
    assert isinstance(one, Fine)


def test_ports_that_are_not_there() -> None:
    one = finding(looked_at(station_cable("hde", "ports = [1]"), "hde", "ports = [1, 3]"))
    assert one.kind == "line.ports"
    assert one.what == "it has no port 3, but the line file lists it"
    assert one.step.endswith("set ports = [1]")


def test_robot_mode_off() -> None:
    one = finding(looked_at(station_cable("dde", sim="robot_mode = false")))
    assert (one.kind, one.step) == ("robot_mode.off", "switch Robot mode on in the station's menu")


@pytest.mark.parametrize(
    ("cable", "kind"),
    [
        (Cable(Silence(), LineFormat()), "line.silent"),
        (Cable(Echo(), None), "line.echo"),
        (Cable(Silence(), LineFormat(250000, "8E1"), speaks=(0.7, b"\x15")), "robot_mode.binary"),
        (None, "port.missing"),
    ],
)
def test_no_station(cable: Cable | None, kind: str) -> None:
    one = finding(looked_at(cable))
    assert one.kind == kind
    assert one.where == "s-1 (/dev/far)"
    assert one.step


def test_a_virtual_station_that_nobody_serves() -> None:
    one = finding(looked_at(None, url="s-1"))
    assert one.step.startswith(f"a relative url is a virtual station's: start `jbclog sim {PLACE}`")


def test_a_bad_link() -> None:
    fault = (
        '[[station.sim.fault]]\nkind = "silence"\ncommand = "station_error"\nat_s = 0.1\nonly ='
        ' "read"'
    )
    found = looked_at(station_cable("dde", sim=fault))
    assert finding(found).kind == "line.noisy"


def test_a_station_error_is_told_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    cable = station_cable("dde")
    monkeypatch.setattr(cable.far.plant, "station_error", 7)  # type: ignore[attr-defined]  # the virtual station's own
    one = finding(looked_at(cable))
    assert one.kind == "station.error"
    assert "transformer overload" in one.what
