"""The line file that a scan writes: read again, it is what was found."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.discovery import text_of
from jbclog.config.line import StationSpec, load_line
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.family import FAMILIES
from jbclog.session.discovery.scan_plan import PortReport, StationFound, Turnaround


def report(url: str, family: str = "dde", **keys: object) -> PortReport:
    values: dict[str, object] = {
        "address": 1,
        "tool_names": {1: "T245", 2: "T210"},
        "turnaround": Turnaround(1.234, 2.0, 12, 12),
    }
    values |= {"line": LineFormat(), "family": FAMILIES[family], "model": family.upper()} | keys
    return PortReport(url, StationFound(**values))  # type: ignore[arg-type]  # keys by name


def written(folder: Path, *reports: PortReport, name: str = "found.toml") -> list[StationSpec]:
    text = text_of(reports, folder / name)
    assert text is not None
    (folder / name).write_text(text, encoding="utf-8")
    return list(load_line(folder / name).stations)


def test_all_that_was_found_stands_in_it(tmp_path: Path) -> None:
    (one,) = written(tmp_path, report("/dev/ttyUSB0", line=LineFormat(9600, "8E1"), address=None))
    assert (one.name, one.url, one.family) == ("dde-1", "/dev/ttyUSB0", "dde")
    assert (one.baudrate, one.format, one.address, one.ports, one.turnaround_ms) == (
        9600,
        "8E1",
        None,
        (1, 2),
        1.3,
    )


def test_every_station_has_a_name_of_its_own(tmp_path: Path) -> None:
    found = written(
        tmp_path,
        report("/dev/a"),
        report("/dev/b", "ale", tool_names={1: "T245"}),
        report("/dev/c"),
    )
    assert [one.name for one in found] == ["dde-1", "ale-1", "dde-2"]


def test_ports_without_a_tool_are_left_out_because_a_run_would_refuse_them(tmp_path: Path) -> None:
    (one,) = written(tmp_path, report("/dev/a", tool_names={1: "none", 2: "T245"}))
    assert one.ports == (2,)


def test_with_no_tool_anywhere_the_ports_that_answer_are_named(tmp_path: Path) -> None:
    (one,) = written(tmp_path, report("/dev/a", tool_names={1: "none", 2: "none"}))
    assert one.ports == (1, 2)


def test_an_omega(tmp_path: Path) -> None:
    omega = report(
        "/dev/a",
        "omega",
        line=LineFormat(9600),
        address=None,
        model=None,
        robot_mode=None,
        tool_names={},
    )
    (one,) = written(tmp_path, omega)
    assert (one.family, one.baudrate, one.address) == ("omega", 9600, None)


def test_a_path_is_written_from_the_root_and_a_link_stays_a_link(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dde-1").symlink_to("/dev/null")
    (one,) = written(tmp_path, report("dde-1"))
    assert one.url == str(tmp_path / "dde-1")


@pytest.mark.parametrize("url", ["socket://127.0.0.1:4001", "rfc2217://host:4001", "COM3"])
def test_what_is_no_path_is_kept(tmp_path: Path, url: str) -> None:
    assert written(tmp_path, report(url))[0].url == url


@pytest.mark.parametrize("model", ["D\nDE]", 'DDE"\x7f', "DDE\u202e\x1b[2J", "[[station]]"])
def test_what_a_station_says_of_itself_cannot_spoil_the_file(tmp_path: Path, model: str) -> None:
    (one,) = written(tmp_path, report("/dev/a", model=model))
    assert one.name == "dde-1"


@pytest.mark.parametrize(
    ("file", "name"), [("bench-3.toml", "bench-3"), ("a b.toml", "line"), ("-x.toml", "line")]
)
def test_the_lines_name_is_the_files_where_it_can_be(tmp_path: Path, file: str, name: str) -> None:
    written(tmp_path, report("/dev/a"), name=file)
    assert load_line(tmp_path / file).name == name


def test_what_no_run_could_begin_with_is_left_out() -> None:
    off = report("/dev/a", robot_mode=False)
    unknown = report("/dev/b", family="dde", model=None)
    assert unknown.station is not None
    unknown.station.family = None
    mute = report("/dev/c", trouble="only 0 of 12")
    assert text_of([off, unknown, mute, PortReport("/dev/d")], Path("x.toml")) is None
