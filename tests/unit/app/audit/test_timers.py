"""What `audit --print-timer` prints: calls that exist, words that arrive as they are, and nothing that systemd has against it."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from jbclog.app.audit.timers import HOUR, MINUTE, UNIT, Timed, cron_line, program, service_text, timer_text, timers_lines
from support.readers.command_line import wrong
from support.readers.unit_file import analyzed, exposed

WORDS = ("--line", "/etc/jbclog/bench 3.toml", "--ledger", "/var/lib/jbclog/100%/$HOME/it's.jsonl")
FOLDERS = ("/var/lib/jbclog/100%/$HOME", '/var/lib/the "pages"')
TIMED = Timed("/opt/jbclog/bin/jbclog", WORDS, FOLDERS, "jbclog")


def test_cron_gives_the_shell_what_was_meant() -> None:
    minute, hour, *days, command = cron_line(TIMED).split(" ", 5)
    assert (int(minute), int(hour), days) == (MINUTE, HOUR, ["*", "*", "*"])
    echoed = command.replace("\\%", "%").replace(TIMED.program, "printf '%s\\n'")
    assert "%" not in command.replace("\\%", "")  # where cron would cut it off
    done = subprocess.run(["/bin/sh", "-c", echoed], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["audit", *WORDS, "--quiet"]


def test_its_call_exists() -> None:
    assert wrong(["audit", *WORDS, "--quiet"]) is None
    assert Path(program()).name == "jbclog"


def test_it_rings_at_an_hour_that_every_day_has_once() -> None:
    assert 4 <= HOUR <= 22


def test_everything_says_where_it_goes() -> None:
    text = "\n".join(timers_lines(TIMED))
    for place in ("crontab -e", f"/etc/systemd/system/{UNIT}.service", f"/etc/systemd/system/{UNIT}.timer", "Task Scheduler"):
        assert place in text


def test_systemd_has_nothing_against_it(tmp_path: Path) -> None:
    service, timer = tmp_path / f"{UNIT}.service", tmp_path / f"{UNIT}.timer"
    there = Timed(str(Path("/bin/true").resolve()), WORDS, ("/var/lib", *FOLDERS), "root")
    service.write_text(service_text(there), encoding="utf-8")
    timer.write_text(timer_text(), encoding="utf-8")
    done = analyzed("verify", "--man=no", service, timer)
    assert [line for line in done.stderr.splitlines() if UNIT in line] == []
    calendar = re.findall(r"OnCalendar=(.*)", timer_text())
    assert analyzed("calendar", *calendar).returncode == 0


def test_systemd_finds_it_closed(tmp_path: Path) -> None:
    service = tmp_path / f"{UNIT}.service"
    service.write_text(service_text(TIMED), encoding="utf-8")
    assert exposed(service) is None


def test_it_may_write_where_its_files_are_and_nowhere_else() -> None:
    """By systemd's own rules: words in double quotes, %% for %; $ means nothing there."""
    (line,) = re.findall(r"^ReadWritePaths=(.*)", service_text(TIMED), re.MULTILINE)
    assert tuple(one.replace("%%", "%") for one in shlex.split(line)) == FOLDERS
    assert "ProtectSystem=strict" in service_text(TIMED)


@pytest.mark.parametrize("word", WORDS)
def test_systemd_is_given_each_word_whole(word: str) -> None:
    """By systemd's own rules: words in double quotes, %% for %, $$ for $."""
    (line,) = re.findall(r"ExecStart=(.*)", service_text(TIMED))
    assert word in [one.replace("%%", "%").replace("$$", "$") for one in shlex.split(line)]
