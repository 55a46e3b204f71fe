"""What a scan says of a station, and what stands in a line file, is what two of its answers say."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from support.clients.talk import framed
from support.invoked import invoked
from support.links.uart_ports import Cable, Coming, FarEnd, access_to, says, station_cable
from support.product import (
    LEARNING_S,
    Fine,
    LineFormat,
    PortReport,
    ScanPlan,
    StationFound,
    diagnose,
    load_line,
    look_at_stations,
    parse_line,
    search_ports,
)

OTHERWISE = {"SMN": "  EEE", "SVR": "9.99", "SER": "00005", "CT2": "00000", "CT1": "00004"}


def scanned(cable: Cable) -> PortReport:
    (report,) = search_ports([("port", ScanPlan())], access=access_to({"port": cable}))
    return report


def station(report: PortReport) -> StationFound:
    assert report.station is not None
    return report.station


@pytest.mark.parametrize("code", OTHERWISE)
@pytest.mark.parametrize("before", [0, 1])
def test_one_answer_changes_nothing_of_what_is_found(code: str, before: int) -> None:
    cable, spoilt = station_cable("dde"), station_cable("dde")
    says(spoilt, code, *[""] * before, OTHERWISE[code])
    true, found = station(scanned(cable)), station(scanned(spoilt))
    assert (found.model, found.family, found.software, found.error) == (
        true.model,
        true.family,
        true.software,
        true.error,
    )
    assert found.tool_names == true.tool_names
    assert found.is_drivable


@pytest.mark.parametrize("code", OTHERWISE)
def test_one_answer_changes_nothing_of_a_line_file(code: str, tmp_path: Path) -> None:
    cable = station_cable("dde")
    says(cable, code, OTHERWISE[code])
    words = ["scan", "/dev/far", "--write", str(tmp_path / "line.toml")]
    ended = invoked(*words, obj=access_to({"/dev/far": cable}))
    assert ended.exit_code == 0
    (spec,) = load_line(tmp_path / "line.toml").stations
    assert (spec.family, spec.address, spec.ports) == ("dde", 1, (1, 2))


@pytest.mark.parametrize("code", OTHERWISE)
def test_one_answer_is_no_finding_of_doctor(code: str) -> None:
    cable = station_cable("dde")
    says(cable, code, OTHERWISE[code])
    line = parse_line(
        '[line]\nname = "x"\n[[station]]\nname = "s-1"\nurl = "/dev/far"\nfamily = "dde"\n',
        Path("line.toml"),
    )
    (looked,) = look_at_stations(line, access=access_to({"/dev/far": cable}))
    assert isinstance(looked, Fine)
    assert "DDE answers at 19200 8N1, address 01" in looked.what


def test_what_two_answers_say_is_found() -> None:
    cable = station_cable("dde")
    says(cable, "SER", "00005", "00005")
    says(cable, "CT2", "00000", "00000")
    found = station(scanned(cable))
    assert found.error is not None
    assert found.tool_names[2] == "none"


class Misaddressed:
    """Swaps the digits of the address in the first answers: the check byte is the same."""

    def __init__(self, behind: FarEnd, times: int) -> None:
        self.behind, self.times = behind, times

    def receive(self, data: bytes, now: float) -> Coming:
        coming = self.behind.receive(data, now)
        if not coming or self.times == 0:
            return coming
        self.times -= 1
        return [(at, one.replace(b"01", b"10", 1)) for at, one in coming]


def test_an_address_counts_when_two_answers_say_it() -> None:
    cable = station_cable("dde")
    cable.far = Misaddressed(cable.far, 1)
    found = station(scanned(cable))
    assert (found.address, found.model, found.is_drivable) == (1, "DDE", True)


class Robot:
    """Says these answers to R-SMN one after the other, and then nothing."""

    def __init__(self, *said: str) -> None:
        self.said = list(said)

    def receive(self, data: bytes, now: float) -> Coming:
        return [(now + 0.02, framed(self.said.pop(0)))] if b"SMN" in data and self.said else []


def test_robot_mode_is_not_off_because_one_answer_says_so() -> None:
    found = station(scanned(Cable(Robot("NSMN00005", "ASMN  DDE", "ASMN  DDE"), LineFormat())))
    assert (found.model, found.robot_mode, found.refusal) == ("DDE", None, None)


MODELS = ("ASMN  DDE", "ASMN  EEE", "ASMN  DME", "NSMN00005", "ASMN  NAE")


def test_a_model_that_is_another_each_time_is_none() -> None:
    report = scanned(Cable(Robot(*MODELS), LineFormat()))
    (finding,) = diagnose(report)
    assert (finding.kind, station(report).model, station(report).family) == (
        "line.noisy",
        None,
        None,
    )
    assert finding.what.endswith(
        "gives a different answer each time: it answered its model as 'DDE' from address 01, 'EEE'"
        " from address 01, 'DME' from address 01, N 00005 from address 01, 'NAE' from address 01"
    )
    assert not station(report).is_drivable


def test_a_model_that_is_said_once_and_no_more_is_none() -> None:
    report = scanned(Cable(Robot("ASMN  DDE"), LineFormat()))
    (finding,) = diagnose(report)
    assert (finding.kind, station(report).model) == ("station.silent", None)
    assert finding.what.endswith(
        ", but not reliably: it answered its model, 'DDE' from address 01, once only"
    )


@pytest.mark.parametrize(
    ("code", "data", "told"),
    [
        (
            "CT2",
            ("00000", "00001", "00003", "00004"),
            "tool of port 2: 0, 1, 3, 4 when asked 4 times",
        ),
        (
            "SER",
            ("00001", "00002", "00003", "00004"),
            "station error: 1, 2, 3, 4 when asked 4 times",
        ),
        ("SVR", ("1", "2", "3", "4"), "software version: 1, 2, 3, 4 when asked 4 times"),
    ],
)
def test_what_is_another_each_time_is_told_and_no_line_file_is_made_of_it(
    code: str, data: tuple[str, ...], told: str, tmp_path: Path
) -> None:
    cable = station_cable("dde")
    says(cable, code, *data)
    words = ["scan", "/dev/far", "--write", str(tmp_path / "line.toml"), "--json"]
    ended = invoked(*words, obj=access_to({"/dev/far": cable}))
    facts = json.loads(ended.stdout)
    assert (ended.exit_code, facts["written"], (tmp_path / "line.toml").exists()) == (
        1,
        None,
        False,
    )
    (finding,) = facts["ports"][0]["findings"]
    assert (finding["kind"], facts["ports"][0]["station"]["trouble"]) == ("line.noisy", told)
    assert told in finding["what"]


@pytest.mark.parametrize("family", ["soldering", "dme", "hde", "jtse"])
def test_the_slowest_station_is_learnt_of_within_its_time(family: str) -> None:
    """A station that answers just in time, with four ports where it has as many."""
    report = scanned(station_cable(family, sim="turnaround_ms = 299"))
    assert station(report).is_drivable
    assert report.seconds < LEARNING_S
