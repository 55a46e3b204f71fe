"""Times on a terminal are local, and a time is read as it is shown; elsewhere both are UTC."""

from __future__ import annotations

import errno
import json
import os
import pty
import subprocess
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from jbclog.cli.times import range_text, shown_moment, typed_moment
from jbclog.core.errors import UsageError
from jbclog.core.rows import StationFacts
from jbclog.record.manifest import LineFile, Manifest, write_manifest

VIENNA = "CET-1CEST,M3.5.0,M10.5.0/3"
RUN = "20261121T013000Z-bench-3-k7qd"
STARTED = "2026-11-21T01:30:00.500000Z"
PROGRAM = (sys.executable, "-c", "from jbclog.cli import main; main()")


@pytest.fixture
def vienna(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with monkeypatch.context() as patched:
        patched.setenv("TZ", VIENNA)
        time.tzset()
        yield
    time.tzset()


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    (folder / RUN).mkdir(parents=True)
    line = LineFile("bench-3", "line.toml", "ab")
    stations = [StationFacts("dde-1", "url", "dde")]
    made = Manifest(RUN, state="sealed", start=STARTED, stop=STARTED, line=line, stations=stations)
    write_manifest(folder / RUN, made)
    return folder


def on_terminal(*words: str | Path) -> str:
    """What a command shows on a terminal in Vienna."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"TZ": VIENNA, "COLUMNS": "200"}
    command = [*PROGRAM, *map(str, words)]
    with subprocess.Popen(command, stdout=theirs, stderr=theirs, env=environment) as process:
        os.close(theirs)
        shown = bytearray()
        try:
            while data := os.read(ours, 4096):
                shown += data
        except OSError as error:
            if error.errno != errno.EIO:  # the end of a terminal
                raise
    os.close(ours)
    assert process.returncode == 0, shown
    return shown.decode().replace("\r\n", "\n")


def in_pipe(*words: str | Path) -> str:
    command = [*PROGRAM, *map(str, words)]
    environment = os.environ | {"TZ": VIENNA}
    ended = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return ended.stdout + ended.stderr


def test_what_a_terminal_shows_finds_the_run_again(runs: Path) -> None:
    shown = on_terminal("runs", runs)
    head, row = shown.splitlines()
    assert head.startswith("start                 line")
    assert row.startswith("2026-11-21 02:30 CET  bench-3")
    for since in ("2026-11-21 02:30 CET", "2026-11-21 02:30", "2026-11-21T02:30"):
        assert RUN in on_terminal("runs", runs, "--since", since)
    assert (
        on_terminal("runs", runs, "--since", "2026-11-21 02:31")
        == f"{runs}: no run matches from 2026-11-21 02:31 CET (01:31 UTC) on\n"
    )


def test_a_day_on_a_terminal_is_a_day_on_the_wall(runs: Path) -> None:
    assert RUN in on_terminal("runs", runs, "--since", "2026-11-21", "--until", "2026-11-21")
    told = on_terminal("runs", runs, "--since", "2026-11-20", "--until", "2026-11-20")
    assert told == (
        f"{runs}: no run matches from 2026-11-20 00:00 CET (2026-11-19 23:00 UTC) to"
        " 2026-11-21 00:00 CET (2026-11-20 23:00 UTC)\n"
    )


def test_a_pipe_has_utc_and_reads_utc(runs: Path) -> None:
    head, row = in_pipe("runs", runs, "--since", "2026-11-21 01:30").splitlines()
    assert head.startswith("start UTC         line")
    assert row.startswith("2026-11-21 01:30  bench-3")
    assert (
        in_pipe("runs", runs, "--since", "2026-11-21 01:31")
        == f"{runs}: no run matches from 2026-11-21 02:31 CET (01:31 UTC) on\n"
    )


def test_json_on_a_terminal_has_utc_and_reads_utc(runs: Path) -> None:
    shown = on_terminal("runs", runs, "--json", "--since", "2026-11-21 01:30")
    assert json.loads(shown)["start"] == STARTED
    told = on_terminal("runs", runs, "--json", "--since", "2026-11-21 02:30")
    assert told.startswith(f"{runs}: no run matches")


@pytest.mark.parametrize(
    ("verb", "options", "told"),
    [
        ("where-used", ("-s", "dde-1"), "no runs from 2026-11-21 02:31 CET (01:31 UTC) on\n"),
        (
            "trend",
            ("--metric", "recovery_s"),
            "no run has recovery_s from 2026-11-21 02:31 CET (01:31 UTC) on\n",
        ),
    ],
)
def test_other_searches_read_times_alike(
    runs: Path, verb: str, options: tuple[str, ...], told: str
) -> None:
    since = ("--since", "2026-11-21 02:31")
    assert on_terminal(verb, runs, *options, *since).endswith(told)


def test_maintenance_is_recorded_at_the_time_on_the_wall(tmp_path: Path) -> None:
    ledger = tmp_path / "counters.jsonl"
    line = tmp_path / "line.toml"
    line.write_text('[line]\nname = "b"\n[[station]]\nname = "d"\nurl = "u"\nfamily = "dde"\n')
    done = ("maintenance", "done", "--line", line, "--ledger", ledger, "-s", "d", "--by", "A")
    task = ("--task", "tip-change", "--port", "1", "--at")
    shown = on_terminal(*done, *task, "2024-11-01 09:30")
    assert shown.startswith("2024-11-01 09:30 CET  d port 1")
    assert json.loads(ledger.read_text())["time"] == "2024-11-01T08:30:00.000+00:00"
    assert in_pipe("maintenance", "list", "--ledger", ledger).splitlines()[1][:16] == (
        "2024-11-01 08:30"
    )
    assert "2024-11-01 09:30 CET" in on_terminal("maintenance", "list", "--ledger", ledger)


@pytest.mark.parametrize(
    "text",
    [
        *("2026-11-21T08:00", "2026-11-21 08:00", "2026-11-21T09:00+01:00", "2026-11-21T08:00Z"),
        *("2026-11-21 08:00 UTC", " 2026-11-21 09:00 CET "),
    ],
)
@pytest.mark.usefixtures("vienna")
def test_a_pipe_reads_utc_where_no_zone_is_named(text: str) -> None:
    expected = datetime(2026, 11, 21, 8, tzinfo=UTC)
    assert typed_moment("--since", text, is_local=False) == expected


@pytest.mark.parametrize(
    ("shown", "utc"),
    [
        ("2026-07-01 02:30 CEST", "2026-07-01T00:30:00Z"),
        ("2026-10-25 02:30 CEST", "2026-10-25T00:30:00Z"),  # this hour comes twice
        ("2026-10-25 02:30 CET", "2026-10-25T01:30:00Z"),
        ("2026-10-25 03:30 CET", "2026-10-25T02:30:00Z"),
    ],
)
@pytest.mark.usefixtures("vienna")
def test_a_shown_time_is_the_one_that_is_read(shown: str, utc: str) -> None:
    assert shown_moment(utc, is_local=True) == shown
    assert typed_moment("--since", shown, is_local=True) == datetime.fromisoformat(utc)


@pytest.mark.usefixtures("vienna")
def test_a_day_ends_at_midnight_also_when_summer_time_ends() -> None:
    end = typed_moment("--until", "2026-10-25", is_local=True, is_end=True)
    assert end == datetime(2026, 10, 25, 23, tzinfo=UTC)


@pytest.mark.parametrize(
    "text", ["", "yesterday", "2026-11-21 08:00 PST", "2026-13-01", "9999-12-31"]
)
@pytest.mark.usefixtures("vienna")
def test_what_is_no_time(text: str) -> None:
    with pytest.raises(UsageError, match="give a day such as"):
        typed_moment("--until", text, is_local=True, is_end=True)


@pytest.mark.usefixtures("vienna")
def test_no_time_is_none_and_a_damaged_one_is_shown_as_it_is() -> None:
    assert typed_moment("--since", None, is_local=True) is None
    assert shown_moment(None, is_local=True) == "-"
    assert shown_moment("soon", is_local=True) == "soon"
    assert range_text(None, None) == ""
    assert range_text(None, datetime(2026, 7, 1, 12, tzinfo=UTC)) == (
        " before 2026-07-01 14:00 CEST (12:00 UTC)"
    )
