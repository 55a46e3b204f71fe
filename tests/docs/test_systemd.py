"""The systemd unit: its commands exist, and nothing in it works against the guard."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.audit.timers import HARDENED
from jbclog.app.safe_state import DONE_S, GUARD_S, KILLED_S, TERM_S
from jbclog.guard.supervisor import TAKEN_OVER_S
from support.readers.command_line import wrong
from support.readers.unit_file import UNIT, analyzed, command, exposed, unit


@pytest.mark.parametrize(("key", "verb"), [("ExecStart", "run"), ("ExecStopPost", "safe")])
def test_its_commands_exist(key: str, verb: str) -> None:
    program, *words = command(key)
    assert Path(program).is_absolute()
    assert Path(program).name == "jbclog"
    assert (words[0], wrong(words)) == (verb, None)


def test_the_line_that_is_recorded_is_the_one_that_is_made_safe() -> None:
    lines = {words[words.index("--line") + 1] for words in (command("ExecStart"), command("ExecStopPost"))}
    assert len(lines) == 1
    assert "%i" in lines.pop()


def test_guard_and_safe_have_time_enough_and_are_not_killed() -> None:
    service = unit()["Service"]
    assert service["KillMode"] == "control-group"  # `mixed` kills the guard as soon as the recorder is dead
    assert "SendSIGKILL" not in service
    assert float(service["TimeoutStopSec"]) > max(TAKEN_OVER_S, TERM_S + KILLED_S + GUARD_S + DONE_S)


def test_nothing_begins_to_heat_by_itself() -> None:
    assert unit()["Service"]["Restart"] == "no"
    assert "Install" not in unit()


def test_what_it_says_to_type_is_its_own_name() -> None:
    assert f"profiles/systemd/{UNIT.name}" in UNIT.read_text(encoding="utf-8").partition("[Unit]")[0]


def test_systemd_itself_has_nothing_against_it(tmp_path: Path) -> None:
    program = Path("/bin/true").resolve()  # in the place of one that is not installed
    copy = tmp_path / UNIT.name.replace("@", "@bench")
    copy.write_text(UNIT.read_text(encoding="utf-8").replace(command("ExecStart")[0], str(program)), encoding="utf-8")
    done = analyzed("verify", "--man=no", copy)
    assert [line for line in done.stderr.splitlines() if UNIT.stem in line] == []


# -- what it may do: tests/serial/test_hardened.py runs it so ---------------------------------------------------------------


def test_systemd_finds_it_closed(tmp_path: Path) -> None:
    copy = tmp_path / UNIT.name.replace("@", "@bench")
    copy.write_text(UNIT.read_text(encoding="utf-8"), encoding="utf-8")
    assert exposed(copy) is None
    copy.write_text(copy.read_text(encoding="utf-8").replace("NoNewPrivileges=yes\nCapabilityBoundingSet=\n", ""), encoding="utf-8")
    assert exposed(copy) is not None  # the threshold is one


def test_it_may_do_no_more_than_the_printed_unit() -> None:
    mine = {line for line in UNIT.read_text(encoding="utf-8").splitlines() if not line.startswith("#")}
    assert {line for line in HARDENED.splitlines() if not line.startswith("#")} <= mine


def test_serial_ports_and_its_own_folder_are_left_to_it() -> None:
    service = unit()["Service"]
    assert "PrivateDevices" not in service
    assert service["SupplementaryGroups"] == "dialout"
    assert {f"DeviceAllow=char-{kind} rw" for kind in ("ttyUSB", "ttyACM", "ttyS")} <= {*UNIT.read_text().splitlines()}
    state = Path("/var/lib", service["StateDirectory"])  # which systemd makes, and keeps writable
    places = (command("ExecStart")[-1], service["Environment"].partition("XDG_STATE_HOME=")[2])
    assert all(Path(place).is_relative_to(state) for place in places)
