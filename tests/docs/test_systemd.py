"""The units and schedules in profiles/: their commands exist, and nothing in the unit of a run
works against the guard.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from support.product import SAFE_DONE_S, SAFE_GUARD_S, SAFE_KILLED_S, SAFE_TERM_S, TAKEN_OVER_S
from support.readers.command_line import wrong
from support.readers.texts import ROOT
from support.readers.unit_file import AUDIT, TIMER, UNIT, analyzed, command, exposed, unit


@pytest.mark.parametrize(("key", "verb"), [("ExecStart", "run"), ("ExecStopPost", "safe")])
def test_its_commands_exist(key: str, verb: str) -> None:
    program, *words = command(key)
    assert Path(program).is_absolute()
    assert Path(program).name == "jbclog"
    assert (words[0], wrong(words)) == (verb, None)


def test_the_line_that_is_recorded_is_the_one_that_is_made_safe() -> None:
    lines = {
        words[words.index("--line") + 1]
        for words in (command("ExecStart"), command("ExecStopPost"))
    }
    assert len(lines) == 1
    assert "%i" in lines.pop()


def test_guard_and_safe_have_time_enough_and_are_not_killed() -> None:
    service = unit()["Service"]
    # `mixed` kills the guard as soon as the recorder is dead
    assert service["KillMode"] == "control-group"
    assert "SendSIGKILL" not in service
    assert float(service["TimeoutStopSec"]) > max(
        TAKEN_OVER_S, SAFE_TERM_S + SAFE_KILLED_S + SAFE_GUARD_S + SAFE_DONE_S
    )


def test_nothing_begins_to_heat_by_itself() -> None:
    assert unit()["Service"]["Restart"] == "no"
    assert "Install" not in unit()


def test_what_it_says_to_type_is_its_own_name() -> None:
    assert (
        f"profiles/systemd/{UNIT.name}" in UNIT.read_text(encoding="utf-8").partition("[Unit]")[0]
    )


def test_systemd_itself_has_nothing_against_it(tmp_path: Path) -> None:
    program = Path("/bin/true").resolve()  # in the place of one that is not installed
    copy = tmp_path / UNIT.name.replace("@", "@bench")
    copy.write_text(
        UNIT.read_text(encoding="utf-8").replace(command("ExecStart")[0], str(program)),
        encoding="utf-8",
    )
    done = analyzed("verify", "--man=no", copy)
    assert [line for line in done.stderr.splitlines() if UNIT.stem in line] == []


# -- what it may do: tests/serial/test_hardened.py runs it so --------------------------------------


def test_systemd_finds_it_closed(tmp_path: Path) -> None:
    copy = tmp_path / UNIT.name.replace("@", "@bench")
    copy.write_text(UNIT.read_text(encoding="utf-8"), encoding="utf-8")
    assert exposed(copy) is None
    copy.write_text(
        copy.read_text(encoding="utf-8").replace(
            "NoNewPrivileges=yes\nCapabilityBoundingSet=\n", ""
        ),
        encoding="utf-8",
    )
    assert exposed(copy) is not None  # the threshold is one


def test_serial_ports_and_its_own_folder_are_left_to_it() -> None:
    service = unit()["Service"]
    assert "PrivateDevices" not in service
    assert service["SupplementaryGroups"] == "dialout"
    assert {f"DeviceAllow=char-{kind} rw" for kind in ("ttyUSB", "ttyACM", "ttyS")} <= {
        *UNIT.read_text().splitlines()
    }
    state = Path("/var/lib", service["StateDirectory"])  # which systemd makes, and keeps writable
    places = (command("ExecStart")[-1], service["Environment"].partition("XDG_STATE_HOME=")[2])
    assert all(Path(place).is_relative_to(state) for place in places)


# -- the audit from a timer ------------------------------------------------------------------------

PROFILES = UNIT.parents[1]
PAGE = ROOT / "docs" / "how-to" / "systemd.md"
CRON = PROFILES / "cron" / "jbclog-audit"
TASKS = PROFILES / "tasks" / "bench.toml"


def cron_words() -> list[str]:
    """The line of the cron file: five fields of time, the user, the command."""
    (line,) = [line for line in CRON.read_text(encoding="utf-8").splitlines() if line[:1].isdigit()]
    return line.split(" ")


def test_each_audit_command_exists() -> None:
    assert wrong(command("ExecStart", AUDIT)[1:]) is None
    assert wrong(cron_words()[7:]) is None


def test_each_audit_names_a_tasks_file_beside_the_line_file() -> None:
    """And the page has the command that puts the shipped one there."""
    for words in (command("ExecStart", AUDIT), cron_words()):
        line, tasks = (Path(words[words.index(option) + 1]) for option in ("--line", "--tasks"))
        assert (tasks.parent, tasks.name) == (line.parent, "tasks.toml")
        assert f"cp {TASKS.relative_to(ROOT)} {tasks}\n" in PAGE.read_text(encoding="utf-8")


def test_every_schedule_is_daily_at_an_hour_that_every_day_has_once() -> None:
    minute, hour, *days = cron_words()[:5]
    assert days == ["*", "*", "*"]
    assert 4 <= int(hour) <= 22
    assert unit(TIMER)["Timer"]["OnCalendar"] == f"*-*-* {int(hour):02}:{minute}:00"


def test_cron_cuts_no_command_at_a_percent_sign() -> None:
    assert "%" not in " ".join(cron_words())


def test_the_page_shows_the_line_of_the_cron_file() -> None:
    assert " ".join(cron_words()) in PAGE.read_text(encoding="utf-8")


def test_systemd_accepts_the_audit_and_its_timer(tmp_path: Path) -> None:
    program = Path("/bin/true").resolve()
    service, timer = tmp_path / AUDIT.name, tmp_path / TIMER.name
    service.write_text(
        AUDIT.read_text(encoding="utf-8").replace(command("ExecStart", AUDIT)[0], str(program)),
        encoding="utf-8",
    )
    timer.write_text(TIMER.read_text(encoding="utf-8"), encoding="utf-8")
    done = analyzed("verify", "--man=no", service, timer)
    assert [line for line in done.stderr.splitlines() if AUDIT.stem in line] == []
    assert analyzed("calendar", unit(TIMER)["Timer"]["OnCalendar"]).returncode == 0
    assert exposed(service) is None


def test_the_audit_may_do_no_more_than_a_run_and_writes_into_one_folder() -> None:
    closed = {
        line
        for line in AUDIT.read_text(encoding="utf-8").splitlines()
        if re.match(r"(?!ProtectHome)[A-Z]\w+=", line)
    }
    closed = {
        line
        for line in closed
        if line.startswith(("Protect", "Restrict", "System", "Capab", "Device", "NoNew", "Lock"))
    }
    assert closed <= {*UNIT.read_text(encoding="utf-8").splitlines()}
    assert len(closed) > 15
    words = shlex.split(unit(AUDIT)["Service"]["ExecStart"])
    state = Path("/var/lib", unit(AUDIT)["Service"]["StateDirectory"])
    assert all(
        Path(words[words.index(option) + 1]).is_relative_to(state)
        for option in ("--ledger", "--html", "--runs")
    )
