"""A scan against stations at every line format, and against everything that is no station, bit by
bit on a virtual clock.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from support.clients.talk import framed
from support.links.uart_ports import Cable, Coming, Echo, Silence, access_to, station_cable
from support.oracles.printed_omega import PageOmega
from support.product import (
    ALL_ADDRESSES,
    BAUDRATES,
    THOROUGH_LINES,
    USUAL_LINES,
    LineFormat,
    PortMissing,
    PortReport,
    ScanPlan,
    StationFound,
    Trial,
    VirtualClock,
    diagnose,
    discovery_text,
    is_harmless,
    parse_line,
    plan_for,
    search_ports,
)

ALL = tuple(dict.fromkeys((*ALL_ADDRESSES, *range(1, 100))))


def scanned(
    cable: Cable, plan: ScanPlan | None = None, clock: VirtualClock | None = None
) -> PortReport:
    (report,) = search_ports(
        [("port", plan or ScanPlan())], access=access_to({"port": cable}, clock)
    )
    return report


def station(report: PortReport) -> StationFound:
    assert report.station is not None
    assert [finding.kind for finding in diagnose(report)] == []
    return report.station


def kinds(report: PortReport) -> list[str]:
    found = diagnose(report)
    assert all(finding.step and finding.what for finding in found)
    return [finding.kind for finding in found]


# -- stations --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("family", "model", "ports"),
    [
        ("soldering", "DDR", [1, 2]),
        ("dde", "DDE", [1, 2]),
        ("nae", "NAE", [1, 2]),
        ("dme", "DME", [1, 2, 3, 4]),
        ("hde", "HDE", [1, 2]),
        ("ucr", "UCR245", [1]),
        ("ale", "ALE", [1]),
        ("jtse", "JTSE", [1]),
    ],
)
def test_every_family_is_known_by_its_model(family: str, model: str, ports: list[int]) -> None:
    found = station(scanned(station_cable(family, sim="turnaround_ms = 2.0")))
    assert (found.model, found.family and found.family.name, found.address, found.robot_mode) == (
        model,
        family,
        1,
        None,
    )
    assert list(found.tool_names) == ports
    assert "none" not in found.tool_names.values()
    assert found.turnaround is not None
    assert found.turnaround.median_ms == pytest.approx(2.0, abs=0.01)
    assert (found.turnaround.answered, found.turnaround.asked) == (12, 12)


def test_an_omega_is_found_by_its_own_question() -> None:
    found = station(scanned(station_cable("omega")))
    assert found.family is not None
    assert (found.family.name, found.model, found.address, found.robot_mode, found.line) == (
        "omega",
        None,
        None,
        None,
        LineFormat(9600),
    )
    assert found.turnaround is not None
    assert 0 < found.turnaround.median_ms <= found.turnaround.p99_ms < 251


@pytest.mark.parametrize("answer", ["a", "a0", "a3"])
def test_an_omega_that_knows_its_printed_page_only(answer: str) -> None:
    """003, 11.3.1: A is answered with a. The JBC questions before it swallow its first A, so it is
    asked twice.
    """
    controller = PageOmega(answer)
    report = scanned(Cable(controller, LineFormat(9600)))
    found = station(report)
    assert found.family is not None
    assert found.family.name == "omega"
    assert found.not_answered == ("temperature_control", "set_temperature_state")
    assert found.turnaround is not None
    assert (found.turnaround.answered, found.turnaround.faster) == (12, None)
    assert found.turnaround.median_ms == pytest.approx(20, abs=0.1)
    assert report.sent[LineFormat(9600), b"\x02A\x0341"] == controller.texts.count("A") + 1


def test_what_is_connected_is_named() -> None:
    found = station(
        scanned(station_cable("dde", sim='tools = { 1 = 2, 2 = 0 }\nsoftware = "8.88"'))
    )
    assert found.tool_names == {1: "T245/T470/TR245/TR470", 2: "none"}
    assert found.software == "8.88"


@pytest.mark.parametrize("baudrate", BAUDRATES)
@pytest.mark.parametrize("form", ["8N1", "8E1", "8O1", "8N2", "8E2", "8O2"])
def test_a_thorough_scan_finds_every_line_format(baudrate: int, form: str) -> None:
    """Stop bits apart, which no receiver tells: rate and parity are found as they are set."""
    cable = station_cable("soldering", f'baudrate = {baudrate}\nformat = "{form}"', "wire = false")
    found = station(scanned(cable, plan_for("port", thorough=True, limit_s=None)))
    assert (found.line.baudrate, found.line.parity) == (baudrate, form[1])


def test_the_usual_scan_tries_the_usual_formats_in_this_order() -> None:
    # docs/reference/contradictions.md, B-1
    assert [str(trial.line) for trial in USUAL_LINES[:3]] == ["19200 8N1", "19200 8E1", "9600 8N1"]
    assert len({trial.line for trial in THOROUGH_LINES}) == len(THOROUGH_LINES) == 72


@pytest.mark.parametrize("address", [1, None, 10])
def test_the_usual_addresses_are_found(address: int | None) -> None:
    keys = f"address = {'false' if address is None else address}"
    assert station(scanned(station_cable("ale", keys))).address == address


def test_an_odd_address_is_found_where_it_is_asked_for() -> None:
    cable = station_cable("ucr", "address = 77")
    assert kinds(scanned(cable)) == ["line.silent"]
    assert station(scanned(cable, ScanPlan(addresses=ALL))).address == 77


def test_a_slow_station_is_known_by_the_address_in_its_answer() -> None:
    """What comes when nobody is being asked was said by 01. A run could not wait for it either."""
    report = scanned(station_cable("dde", sim="turnaround_ms = 400"))
    assert report.station is not None
    assert (report.station.model, report.station.address) == ("DDE", 1)
    assert kinds(report) == ["station.silent"]
    assert "only 0 of 12 questions were answered in time" in diagnose(report)[0].what


class OnlyWithout:
    """Finds fault with addressed frames (docs/reference/contradictions.md, B-14), and answers those
    without addresses.
    """

    def receive(self, data: bytes, now: float) -> Coming:
        if data[1:2].isdigit():
            return [(now + 0.02, framed("NSMN00002"))]
        return [(now + 0.02, framed("ASMN  DDE" if b"SMN" in data else "N00004", source=None))]


def test_a_fault_found_with_the_frame_is_no_answer_yet() -> None:
    report = scanned(Cable(OnlyWithout(), LineFormat()))
    assert report.station is not None
    assert (report.station.model, report.station.address) == ("DDE", None)


class Refuses:
    def __init__(self, code: int) -> None:
        self.code = code

    def receive(self, data: bytes, now: float) -> Coming:
        return [(now + 0.02, framed(f"NSMN{self.code:05d}"))]


@pytest.mark.parametrize("code", [1, 2, 4, 6, 99999])
def test_a_station_that_refuses_all_the_same_is_told(code: int) -> None:
    report = scanned(Cable(Refuses(code), LineFormat()))
    assert kinds(report) == ["station.refuses"]
    assert f"N {code:05d}" in diagnose(report)[0].what


def test_behind_an_adapter_with_echo_a_station_is_found() -> None:
    cable = station_cable("dde")
    cable.far = Echo(cable.far)
    assert station(scanned(cable)).model == "DDE"


# -- what is no station to drive -------------------------------------------------------------------


@pytest.mark.parametrize("keys", ["", "address = false", 'baudrate = 57600\nformat = "8E1"'])
def test_robot_mode_off_is_an_answer(keys: str) -> None:
    report = scanned(station_cable("dde", keys, "robot_mode = false"))
    assert kinds(report) == ["robot_mode.off"]
    assert report.station is not None
    assert report.station.robot_mode is False
    assert report.station.line.baudrate == (57600 if keys.startswith("baud") else 19200)
    assert diagnose(report)[0].step == "switch Robot mode on in the station's menu"


@pytest.mark.parametrize(
    "line", [LineFormat(250000, "8E1"), LineFormat(500000, "8E1"), LineFormat(500000)]
)
@pytest.mark.parametrize(
    "said", [b"\x15", b"\x15\x15\x15", b"\x10\x02\x01\x00\xfd\x00\x00\xff\x10\x03"]
)
def test_the_binary_protocol_is_told_by_what_it_says(line: LineFormat, said: bytes) -> None:
    report = scanned(Cable(Silence(), line, speaks=(1.0, said)))
    assert kinds(report) == ["robot_mode.binary"]
    assert report.binary is not None
    assert report.binary.baudrate == line.baudrate


@pytest.mark.parametrize(
    "said", [b"\xaa", framed("ATT100077"), framed("ASMNDDE")], ids=["noise", "an answer", "models"]
)
def test_a_port_that_is_flooded_is_told_within_seconds(said: bytes) -> None:
    clock = VirtualClock()
    began, flood = clock.monotonic(), (said * 1000)[:1000]
    report = scanned(Cable(Silence(), LineFormat(), speaks=(0.01, flood)), clock=clock)
    assert kinds(report) == ["link.flooded"]
    (finding,) = diagnose(report)
    assert "bytes came in 1." in finding.what
    assert finding.step == "find what sends on it"
    assert clock.monotonic() - began < 15
    assert sum(map(len, report.garbage.values())) <= 256 * len(report.tried)


@pytest.mark.parametrize("every_s", [0.5, 0.05])
def test_something_that_speaks_a_little_is_no_flood(every_s: float) -> None:
    assert kinds(
        scanned(Cable(Silence(), LineFormat(4800), speaks=(every_s, b"$GPRMC,1*6A\r\n")))
    ) == ["line.format"]


def test_a_model_that_no_table_has_is_told_and_not_driven() -> None:
    report = scanned(station_cable("dde", sim='model = "ZZQ"'))
    assert kinds(report) == ["station.unknown"]
    assert "'ZZQ'" in diagnose(report)[0].what
    assert report.station is not None
    assert report.station.tool_names == {1: "tool_2", 2: "tool_2"}
    assert diagnose(report)[0].step.endswith('add model = "ZZQ"')
    assert "name its family" in diagnose(report)[0].step


def test_the_line_file_proposes_the_key_for_it_as_comments(tmp_path: Path) -> None:
    found = scanned(station_cable("dde"))
    unknown = replace(scanned(station_cable("dde", sim='model = "ZZQ"')), url="/dev/ttyUSB7")
    text = discovery_text([found, unknown], tmp_path / "line.toml")
    assert text is not None
    assert [station.family for station in parse_line(text, tmp_path / "line.toml").stations] == [
        "dde"
    ]
    _, _, rest = text.partition("# Model ZZQ is unknown.")
    proposed = "\n".join(line.removeprefix("# ") for line in rest.splitlines()[1:]).replace(
        '"..."', '"dde"'
    )
    (station,) = parse_line(f'[line]\nname = "x"\n{proposed}', tmp_path / "line.toml").stations
    assert (station.model, station.url, station.ports) == ("ZZQ", "/dev/ttyUSB7", (1, 2))
    alone = discovery_text([unknown], tmp_path / "line.toml")
    assert alone is not None
    assert alone.endswith(text.partition("# Model ZZQ")[2])


def test_a_loop_back_is_told() -> None:
    report = scanned(Cable(Echo(), None))
    assert kinds(report) == ["line.echo"]
    assert report.garbage == {}


def test_something_else_that_speaks_is_shown_with_its_bytes() -> None:
    report = scanned(Cable(Silence(), LineFormat(4800), speaks=(0.5, b"$GPRMC,1*6A\r\n")))
    assert kinds(report) == ["line.format"]
    assert all(len(data) <= 256 for data in report.garbage.values())
    assert "scan --thorough port" in diagnose(report)[0].step


def test_nobody() -> None:
    report = scanned(Cable(Silence(), LineFormat()))
    assert kinds(report) == ["line.silent"]
    assert report.tried == [trial.line for trial in USUAL_LINES]
    assert "12 line formats" in diagnose(report)[0].what
    step = diagnose(report)[0].step
    assert step.startswith("check that the station is on and that Robot mode is on in its menu")
    assert step.endswith(
        "try every line format and address (at most 42 min): `jbclog scan port --thorough"
        " --addresses 1-99`"
    )
    assert "RJ12" not in step
    assert sum(report.sent.values()) == len(USUAL_LINES) * len(ALL_ADDRESSES) + 2  # OMEGA's A
    assert report.seconds <= ScanPlan().seconds


def test_no_port() -> None:
    (report,) = search_ports([("elsewhere", ScanPlan())], access=access_to({}))
    assert isinstance(report.broken, PortMissing)
    assert kinds(report) == ["port.missing"]
    assert diagnose(report)[0].what == "no such port"
    assert diagnose(report)[0].step == "check that it is plugged in"


def test_a_cable_that_is_pulled_meanwhile() -> None:
    clock = VirtualClock()
    cable = Cable(Silence(), LineFormat())
    cable.breaks_at = clock.monotonic() + 2.0
    report = scanned(cable, clock=clock)
    assert kinds(report) == ["port.broken"]
    assert report.tried == [trial.line for trial in USUAL_LINES[:3]]


def test_a_cable_that_is_pulled_while_the_station_is_asked_who_it_is() -> None:
    clock = VirtualClock()
    cable = station_cable("dde", clock=clock)
    cable.breaks_at = clock.monotonic() + 0.05
    report = scanned(cable, clock=clock)
    assert kinds(report) == ["port.broken"]
    assert report.station is not None
    assert report.station.model == "DDE"
    assert not report.station.is_drivable


def test_a_station_that_falls_silent_is_told_as_that() -> None:
    report = scanned(
        station_cable("dde", sim='[[station.sim.fault]]\nkind = "silence"\nat_s = 0.05')
    )
    assert kinds(report) == ["station.silent"]
    assert report.station is not None
    assert report.station.model == "DDE"
    assert report.seconds < ScanPlan().seconds


# -- bounds, and what is sent ----------------------------------------------------------------------


def test_the_time_is_bounded_and_what_was_not_tried_is_said() -> None:
    report = scanned(Cable(Silence(), LineFormat()), ScanPlan(limit_s=2.0))
    assert report.seconds < 2.0 + USUAL_LINES[0].seconds(ALL_ADDRESSES)
    assert report.tried + report.untried == [trial.line for trial in USUAL_LINES]
    assert report.untried
    assert kinds(report) == ["scan.cut"]
    assert diagnose(report)[0].step == "give it more time: `jbclog scan port` without --seconds"


def test_more_time_is_asked_for_with_all_that_was_asked_for() -> None:
    plan = plan_for("port", thorough=True, addresses=(*ALL_ADDRESSES, 2, 5, 6, 7), limit_s=2.0)
    report = scanned(Cable(Silence(), LineFormat()), plan)
    assert (
        diagnose(report)[0].step
        == "give it more time: `jbclog scan port --thorough --addresses 2,5-7` without --seconds"
    )


@pytest.mark.parametrize(
    "keys",
    [
        "baudrate = 4800\nformat = '8O2'",
        "baudrate = 115200\nformat = '8O2'",
        "baudrate = 19200\nformat = '8E1'\naddress = 7",
    ],
)
def test_a_format_or_address_that_was_not_tried_comes_before_the_wires(keys: str) -> None:
    silent = scanned(station_cable("soldering", f"{keys}\nports = [1]"))
    assert silent.station is None
    assert "--thorough --addresses 1-99" in diagnose(silent)[0].step


def test_the_wires_are_the_last_step() -> None:
    silent = PortReport(
        "port",
        tried=[trial.line for trial in THOROUGH_LINES],
        asked=(*ALL_ADDRESSES, *range(1, 100)),
    )
    assert diagnose(silent)[0].step.endswith(
        "exchange transmit and receive in the cable (RJ12: pins 3 and 4)"
    )
    assert "--thorough" in diagnose(replace(silent, asked=ALL_ADDRESSES))[0].step
    assert "--thorough" in diagnose(replace(silent, tried=silent.tried[:12]))[0].step


def test_behind_a_server_only_the_addresses_are_left_to_try() -> None:
    silent = PortReport("socket://host:1", tried=[LineFormat()])
    assert diagnose(silent)[0].step.endswith("`jbclog scan socket://host:1 --addresses 1-99`")
    assert diagnose(replace(silent, asked=(*ALL_ADDRESSES, *range(1, 100))))[0].step.endswith(
        "(RJ12: pins 3 and 4)"
    )


@pytest.mark.parametrize("address", [99, 20, 2])
@pytest.mark.parametrize("says", ["ASER00000", "WPS100001", "RTT1"])
def test_a_frame_from_an_address_that_was_not_asked_names_it_and_the_option(
    address: int, says: str
) -> None:
    """It came whole, so the line format is right."""
    speaks = framed(says, *((0, address) if says[0] in "RW" else (address, 0)))
    report = scanned(Cable(Silence(), LineFormat(9600), speaks=(2.0, speaks)))
    assert kinds(report) == ["line.address"]
    (found,) = diagnose(report)
    assert f"address {address:02d}" in found.what
    assert ("fume extractors" in found.what) == (address == 20)
    assert (
        found.step
        == f"scan that address: `jbclog scan port --addresses {address}`; in the line file, set"
        f" `address = {address}`"
    )


def test_the_option_that_is_named_finds_it() -> None:
    cable = station_cable("dde", "address = 99")
    assert (
        station(
            scanned(cable, plan_for("port", addresses=(*ALL_ADDRESSES, 99), limit_s=None))
        ).address
        == 99
    )


def test_a_frame_from_an_address_that_was_asked_is_none_that_says_its_model() -> None:
    speaks = framed("ASER00000", 20)
    report = scanned(
        Cable(Silence(), LineFormat(), speaks=(2.0, speaks)),
        ScanPlan(addresses=(*ALL_ADDRESSES, 20)),
    )
    (found,) = diagnose(report)
    assert (found.kind, found.step) == (
        "station.refuses",
        "connect a station that jbclog drives; this one does not report its model",
    )


def test_a_refusal_by_an_address_that_does_not_answer_names_it_too() -> None:
    report = scanned(Cable(Silence(), LineFormat(9600), speaks=(2.0, framed("N00004", 99))))
    (found,) = diagnose(report)
    assert found.kind == "line.address"
    assert "a station answers at 9600 8N1, address 99, but not reliably: " in found.what
    assert (
        found.step == "scan that address: `jbclog scan port --addresses 99`; in the line file, set"
        " `address = 99`"
    )


class Refuser:
    """A station at address 99 that finds fault with frames for others, as some may
    (docs/reference/contradictions.md, B-14).
    """

    def receive(self, data: bytes, now: float) -> Coming:
        return [(now + 0.01, framed("NSMN00002", 99))]


def test_a_refusal_from_an_address_that_was_not_asked_names_it() -> None:
    report = scanned(Cable(Refuser(), LineFormat()))
    (found,) = diagnose(report)
    assert found.kind == "line.address"
    assert "--addresses 99" in found.step


def test_a_line_full_of_noise_takes_no_longer() -> None:
    report = scanned(
        Cable(Silence(), LineFormat(115200), speaks=(0.003, b"\x02\x8f\x15")), ScanPlan(limit_s=5.0)
    )
    assert report.seconds < 5.0 + max(trial.seconds(ALL_ADDRESSES) for trial in USUAL_LINES)


def test_a_thorough_scan_with_all_addresses_ends_too() -> None:
    plan = plan_for("port", thorough=True, addresses=ALL, limit_s=30.0)
    assert scanned(Cable(Silence(), LineFormat()), plan).seconds < 31.0


@pytest.mark.parametrize("family", ["dde", "ale", "jtse", "omega", "soldering"])
def test_nothing_but_harmless_questions_is_sent_and_all_of_it_is_told(family: str) -> None:
    cable = station_cable(family)
    report = scanned(cable)
    assert all(is_harmless(data) for _, data in cable.asked)
    assert sum(report.sent.values()) == len(cable.asked)
    assert {key: cable.asked.count(key) for key in cable.asked} == dict(report.sent)


def test_latched_alarms_stay_where_they_are() -> None:
    """R-TA clears what it reads (manual 000, 4.8.27): a scan must leave that to the run."""
    cable = station_cable("dde")
    scanned(cable)
    assert not any(b"RTA" in data for _, data in cable.asked)


def test_a_servers_line_format_is_its_own_business() -> None:
    plan = plan_for("socket://host:1", limit_s=None)
    assert [trial.line for trial in plan.trials] == [LineFormat()]
    assert plan.trials[0].asks_omega


def test_a_trial_says_how_long_it_takes() -> None:
    cable = Cable(Silence(), LineFormat(1200))
    trial = Trial(LineFormat(1200), asks_omega=True, listens_s=1.0)
    report = scanned(cable, ScanPlan((trial,)))
    # OMEGA's answer at 1200, which it does not speak
    assert report.seconds <= trial.seconds(ALL_ADDRESSES) + 0.3
