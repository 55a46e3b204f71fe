"""What `jbclog doctor` says and ends with."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from jbclog.app import doctor
from jbclog.app.port_access import PortAccess
from jbclog.core.serial_line import LineFormat
from support.invoked import invoked
from support.links.uart_ports import Cable, Silence, access_to, station_cable

LINE = '[line]\nname = "x"\n[[station]]\nname = "s-1"\nurl = "/dev/ttyJBC"\nfamily = "dde"\n'


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a line file, on a machine with a good clock and no USB ports."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(doctor, "clock_is_kept", lambda: True)
    monkeypatch.setattr(doctor, "usb_ports", list)
    (tmp_path / "line.toml").write_text(LINE)
    return tmp_path


def said(*options: str, access: PortAccess | None = None) -> tuple[int, list[str]]:
    ended = invoked("doctor", *options, obj=access)
    return ended.exit_code, ended.stdout.splitlines()


def test_a_machine_where_everything_is_fine(place: Path) -> None:
    code, lines = said()
    assert code == 0
    assert [line[:8] for line in lines[:-1]] == ["fine    "] * 5
    assert lines[2] == "fine     open leases: they can be listed"
    assert lines[3] == "fine     USB: no USB serial port is connected"
    assert lines[4].startswith("fine     memory: commands that read records use at most ")
    assert lines[5:] == ["no findings"]
    assert sorted(path.name for path in place.iterdir()) == ["line.toml"]


def test_a_line_whose_station_answers(place: Path) -> None:
    code, lines = said(
        "--line", "line.toml", access=access_to({"/dev/ttyJBC": station_cable("dde")})
    )
    assert code == 0
    assert lines[3].startswith("fine     s-1: DDE answers at 19200 8N1, address 01 in 1.0 ms")


def test_each_finding_has_its_step(place: Path) -> None:
    code, lines = said(
        "--line", "line.toml", access=access_to({"/dev/ttyJBC": Cable(Silence(), LineFormat())})
    )
    assert code == 1
    assert lines[3].startswith(
        "FINDING  s-1 (/dev/ttyJBC): nothing answers in 12 line formats (19200 8N1"
    )
    assert lines[4].startswith("  step   check that the station is on")
    assert lines[-1] == "1 finding"


def test_json(place: Path) -> None:
    code, lines = said("--line", "line.toml", "--json", access=access_to({}))
    told = json.loads("\n".join(lines))
    assert code == 1
    assert told["fine"] is False
    assert [one["kind"] for one in told["looked"]] == [
        "disk",
        "clock",
        "guard.list",
        "port.missing",
        "memory",
    ]
    assert [one["step"] is None for one in told["looked"]] == [True, True, True, False, True]


def test_a_wrong_line_file_is_wrong_usage(place: Path) -> None:
    (place / "line.toml").write_text("[line]\n")
    assert said("--line", "line.toml") == (2, [])
