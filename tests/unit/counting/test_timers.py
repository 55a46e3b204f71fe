"""What `audit --print-timer` prints: calls that exist, words that arrive as they are, and nothing that systemd has against it."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from verbs import wrong

from jbclog.counting.timers import HOUR, MINUTE, UNIT, Timed, cron_line, program, service_text, timer_text, timers_lines

WORDS = ("--line", "/etc/jbclog/bench 3.toml", "--ledger", "/var/lib/jbclog/100%/$HOME/it's.jsonl")
TIMED = Timed("/opt/jbclog/bin/jbclog", WORDS, "/var/lib/jbclog", "jbclog")


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
    """Where it is installed: this is no test of it."""
    if (analyze := shutil.which("systemd-analyze")) is None:
        return
    service, timer = tmp_path / f"{UNIT}.service", tmp_path / f"{UNIT}.timer"
    there = Timed(str(Path("/bin/true").resolve()), WORDS, "/var/lib", "root")
    service.write_text(service_text(there), encoding="utf-8")
    timer.write_text(timer_text(), encoding="utf-8")
    done = subprocess.run(
        [analyze, "verify", "--man=no", str(service), str(timer)], capture_output=True, text=True, check=False, timeout=200
    )
    assert [line for line in done.stderr.splitlines() if UNIT in line] == []
    calendar = re.findall(r"OnCalendar=(.*)", timer_text())
    assert subprocess.run([analyze, "calendar", *calendar], capture_output=True, check=False, timeout=200).returncode == 0


@pytest.mark.parametrize("word", WORDS)
def test_systemd_is_given_each_word_whole(word: str) -> None:
    """By systemd's own rules: words in double quotes, %% for %, $$ for $."""
    (line,) = re.findall(r"ExecStart=(.*)", service_text(TIMED))
    assert word in [one.replace("%%", "%").replace("$$", "$") for one in shlex.split(line)]
