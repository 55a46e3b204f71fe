"""What `jbclog scan` is asked for, and how it says what it found."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from jbclog.cli.scan import _addresses, _ports
from jbclog.core.errors import UsageError
from jbclog.core.serial_line import LineFormat
from support.invoked import invoked
from support.links.uart_ports import Cable, Echo, Silence, access_to, station_cable


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (None, (1, None, 10)),
        ("5", (1, None, 10, 5)),
        ("2,5-7", (1, None, 10, 2, 5, 6, 7)),
        ("1-99", (1, None, 10, *range(2, 10), *range(11, 100))),
    ],
)
def test_addresses_come_behind_the_usual_ones(
    text: str | None, found: tuple[int | None, ...]
) -> None:
    assert _addresses(text) == found


@pytest.mark.parametrize("text", ["0", "100", "5-3", "a", "1-", "1,,2", "-1", "1-100"])
def test_addresses_that_there_are_not(text: str) -> None:
    with pytest.raises(UsageError, match="must be 1 to 99"):
        _addresses(text)


def test_a_port_with_two_names_is_asked_once(tmp_path: Path) -> None:
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyUSB0")
    named = [
        str(tmp_path / "by-id"),
        str(tmp_path / "ttyUSB0"),
        "socket://host:1",
        "socket://host:2",
    ]
    assert _ports(named) == [named[0], *named[2:]]


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("socket://foo", '"socket://foo" is not allowed; socket://HOST:PORT'),
        ("socket://foo:99999", '"socket://foo:99999" is not allowed; socket://HOST:PORT'),
        ("rfc2217://:4001", '"rfc2217://:4001" is not allowed; rfc2217://HOST:PORT'),
        ("http://x", 'the kind of port "http" is unknown'),
    ],
)
def test_what_is_no_url_of_a_port_is_wrong_usage(url: str, why: str) -> None:
    ended = invoked("scan", url)
    assert ended.exit_code == 2
    assert why in ended.stderr
    assert (
        "A port is a device such as /dev/ttyUSB0, socket://HOST:PORT or rfc2217://HOST:PORT"
        in ended.stderr
    )


def said(cables: dict[str, Cable], *options: str) -> tuple[int, str]:
    """Exit code and stdout of a scan of these cables' urls."""
    ended = invoked("scan", *options, *cables, obj=access_to(cables))
    return ended.exit_code, ended.stdout


class Babble:
    """A device of another kind: it answers anything with the same bytes."""

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        return [(now + 0.01, b"\xff\xfe\xfd")]


FRAME = "02 30 30 30 31 52 53 4d 4e 03 02"


@pytest.mark.parametrize("options", [(), ("--verbose",)])
def test_a_station_is_told_in_a_few_lines_and_frames_with_verbose(options: tuple[str, ...]) -> None:
    cable = station_cable("ucr", sim="tool = 9\nturnaround_ms = 2.0")
    code, text = said({"/dev/ttyUSB0": cable}, *options)
    assert code == 0
    assert text.splitlines()[:6] == [
        "/dev/ttyUSB0  UCR245, family ucr",
        "  line        19200 8N1, address 01",
        "  Robot mode  not known until the first write",
        "  software    1.00a",
        "  ports       1 TRA245/TRA470",
        "  response    2.00 ms median, 2.00 ms 99th percentile",
    ]
    sent = f"Sent {len(cable.asked)} queries; wrote and cleared nothing"
    if options:
        assert f"{sent}:\n" in text
        assert f"     2 × model, to address 01, at 19200 8N1: {FRAME}\n" in text
    else:
        assert text.endswith(f"{sent} (--verbose lists them).\n")
        assert FRAME not in text


def test_bytes_that_are_no_answer_are_counted_in_words_and_shown_with_verbose() -> None:
    cable = {"/dev/ttyUSB0": Cable(Babble(), LineFormat())}
    _, text = said(cable)
    assert "data arrives, but fits no line format that was tried: 9 bytes at 19200 8N1" in text
    assert "ff fe" not in text
    assert "  bytes       at 19200 8N1: ff fe" in said(cable, "--verbose")[1]


def test_a_named_port_without_a_station_ends_with_1_and_the_step() -> None:
    code, text = said({"/dev/ttyUSB0": Cable(Echo(), None)})
    assert code == 1
    assert "  finding     each question comes back unchanged" in text
    assert "  step        remove the loopback plug" in text


def test_what_there_was_no_time_for_is_named() -> None:
    code, text = said({"/dev/ttyUSB0": Cable(Silence(), LineFormat())}, "--seconds", "3")
    assert code == 1
    assert "  not tried   " in text
    assert "115200 8E1" in text.partition("not tried")[2].splitlines()[0]


def test_json_tells_the_same() -> None:
    cable = station_cable("dde", "address = false", "robot_mode = false")
    code, text = said({"/dev/ttyUSB0": cable}, "--json")
    told = json.loads(text)
    assert code == 1
    assert told["written"] is None
    assert told["ports"][0]["station"]["robot_mode"] is False
    assert told["ports"][0]["findings"][0]["kind"] == "robot_mode.off"
    assert (
        told["ports"][0]["questions"]
        == sum(one["count"] for one in told["sent"])
        == len(cable.asked)
    )
    assert told["sent"][0] == {
        "question": "model, to address 01",
        "hex": "0230303031" + "52534d4e0302",
        "line": "19200 8N1",
        "count": 1,
    }


def test_a_line_file_is_not_written_where_there_is_nothing_to_run(tmp_path: Path) -> None:
    file = tmp_path / "line.toml"
    code, text = said(
        {"/dev/ttyUSB0": station_cable("dde", sim="robot_mode = false")}, "--write", str(file)
    )
    assert code == 1
    assert not file.exists()
    assert f"not written: {file}; no station that jbclog can drive" in text


def test_a_model_that_no_table_has_is_a_line_to_be_completed(tmp_path: Path) -> None:
    file = tmp_path / "line.toml"
    _, text = said(
        {"/dev/ttyUSB0": station_cable("dde", sim='model = "DIE"')}, "--write", str(file)
    )
    assert '# model = "DIE"' in file.read_text()
    assert '# family = "..."' in file.read_text()
    assert "no station active yet: enter the family and remove the # before its lines." in text
