"""`jbclog maintenance`: which station and which task is meant, and what the ledger is told."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest
from typer.testing import Result

from jbclog.maintenance.counter_totals.observed import Count, Fact, Observation
from jbclog.maintenance.fleet_of_ledger import fleet_of
from jbclog.maintenance.ledger import add, read_book
from support.invoked import invoked

AT = "2026-11-21T06:17:00.000+00:00"
DONE = ("--task", "tip-change", "--tip", "T-17", "--port", "1", "--by", "A. Rossi")


def seen(line: str, station: str) -> Observation:
    counts = tuple(Count(port, "work_h", "h", 5.0) for port in (1, 2))
    return Observation(AT, AT, line, station, f"/dev/{station}", True, counts=counts)


@pytest.fixture
def ledger(tmp_path: Path) -> Path:
    path = tmp_path / "counters.jsonl"
    add(path, [seen("bench-3", "dde-1"), seen("bench-3", "ale-1"), seen("hall", "ale-1")])
    return path


def call(*words: str | Path) -> Result:
    return invoked("maintenance", *words)


def test_a_fact_is_kept_as_it_was_told(ledger: Path) -> None:
    ended = call(
        "done",
        "--station",
        "dde-1",
        *DONE,
        "--at",
        "2024-11-20T14:30",
        "--note",
        "worn",
        "--ledger",
        ledger,
    )
    assert (ended.exit_code, ended.stderr) == (0, "")
    assert (
        ended.stdout
        == "2024-11-20 14:30  dde-1 port 1  tip-change  A. Rossi  T-17  worn  (line 4 of"
        f" {ledger})\n"
    )
    (fact,) = read_book(ledger).facts
    assert (fact.line, fact.station, fact.task, fact.port, fact.part) == (
        "bench-3",
        "dde-1",
        "tip-change",
        1,
        "T-17",
    )
    assert fact.time == "2024-11-20T14:30:00.000+00:00"
    assert fact.told > fact.time
    assert (fact.seq, read_book(ledger).wrong) == (4, [])


def test_who_is_logged_in_did_it_now_where_nobody_says_else(
    ledger: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LOGNAME", "weber")
    told = json.loads(
        call("done", "-s", "dde-1", "--task", "verification", "--ledger", ledger, "--json").stdout
    )
    assert (told["by"], told["port"], told["part"], told["time"]) == (
        "weber",
        None,
        "",
        told["told"],
    )


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("done", "-s", "dde-2", *DONE), "has no station of that name; did you mean dde-1?"),
        (("done", "-s", "qqqq", *DONE), "has no station of that name; there are ale-1, dde-1"),
        (
            ("done", "-s", "ale-1", *DONE),
            "several lines have a station of that name; give bench-3/ale-1 or hall/ale-1",
        ),
        (
            ("done", "-s", "dde-1", "--task", "tip-chnge"),
            "did you mean tip-change, cartridge-change?; give a tasks file",
        ),
        (("done", "-s", "dde-1"), "give `done` with --station and --task, or `list`"),
        (
            ("done", "-s", "dde-1", "--task", "service", "--port", "4"),
            "--port 4: dde-1 has no such port; its ports are 1, 2",
        ),
        (("done", "-s", "dde-1", "--task", "service", "--by", " "), "--by: must not be empty"),
        (("undo",), "give `done` with --station and --task, or `list`"),
        (("done", "-s", "dde-1", *DONE, "--at", "2126-01-01"), "is in the future"),
        (("done", "-s", "dde-1", *DONE, "--at", "yesterday"), "give a day such as"),
        (("done", "-s", "dde-1", *DONE, "--note", "a\nb"), "hidden or control character"),
        (("list", "-s", "dde-2"), "did you mean dde-1"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_what_can(
    ledger: Path, words: tuple[str, ...], told: str
) -> None:
    before = ledger.read_bytes()
    ended = call(*words, "--ledger", ledger)
    assert (ended.exit_code, ended.stdout) == (2, "")
    assert told in ended.stderr
    assert ledger.read_bytes() == before


def test_a_station_of_two_lines_is_named_with_its_line(ledger: Path) -> None:
    assert call("done", "-s", "hall/ale-1", *DONE, "--ledger", ledger).exit_code == 0
    assert [fact.line for fact in read_book(ledger).facts] == ["hall"]


def test_a_ledger_that_is_not_there_knows_no_station_but_those_of_a_line_file(
    tmp_path: Path,
) -> None:
    ledger, line = tmp_path / "new.jsonl", tmp_path / "line.toml"
    line.write_text(
        '[line]\nname = "bench-3"\n[[station]]\nname = "dde-1"\nurl = "/dev/x"\nfamily = "dde"\n',
        encoding="utf-8",
    )
    refused = call("done", "-s", "dde-1", *DONE, "--ledger", ledger)
    assert (refused.exit_code, "has no station yet" in refused.stderr, ledger.exists()) == (
        2,
        True,
        False,
    )
    assert call("done", "-s", "dde-1", *DONE, "--ledger", ledger, "--line", line).exit_code == 0
    assert [(fact.line, fact.station) for fact in read_book(ledger).facts] == [("bench-3", "dde-1")]


def test_a_tasks_file_says_which_tasks_there_are(ledger: Path, tmp_path: Path) -> None:
    tasks = tmp_path / "tasks.toml"
    tasks.write_text(
        '[[task]]\nname = "guide-tube"\ncounter = "dispensed_mm"\nlife_m = 100\n', encoding="utf-8"
    )
    asked = ("done", "-s", "dde-1", "--ledger", ledger, "--by", "W", "--tasks", tasks)
    assert call(*asked, "--task", "guide-tube").exit_code == 0
    assert call(*asked, "--task", "counters-reset").exit_code == 0  # which needs no tasks file
    refused = call(*asked, "--task", "tip-change")
    assert refused.exit_code == 2
    assert (
        "there are counters-reset, counters-rolled-over, guide-tube, station-replaced"
        in refused.stderr
    )


def test_the_list_has_what_was_done_in_order(ledger: Path) -> None:
    for day, station in (
        ("2024-11-03", "dde-1"),
        ("2024-11-01", "dde-1"),
        ("2024-11-02", "hall/ale-1"),
    ):
        call("done", "-s", station, *DONE, "--at", day, "--ledger", ledger)
    assert [line[:10] for line in call("list", "--ledger", ledger).stdout.splitlines()[1:]] == [
        "2024-11-01",
        "2024-11-02",
        "2024-11-03",
    ]
    assert len(call("list", "-s", "dde-1", "--ledger", ledger).stdout.splitlines()) == 3  # heads
    assert [
        one["station"]
        for one in json.loads(call("list", "--ledger", ledger, "--json").stdout)["facts"]
    ] == [
        "dde-1",
        "ale-1",
        "dde-1",
    ]


def test_a_damaged_ledger_takes_the_fact_and_says_so(ledger: Path) -> None:
    ledger.write_bytes(ledger.read_bytes().replace(b"hall", b"hell"))
    ended = call("done", "-s", "dde-1", *DONE, "--ledger", ledger)
    assert ended.exit_code == 4
    assert "(line" in ended.stdout
    assert f"{ledger}: line 3 is no line of a ledger, or was changed" in ended.stderr
    assert [type(one) for one in read_book(ledger).entries] == [Observation, Observation, Fact]
    assert call("list", "--ledger", ledger).exit_code == 4


def test_a_ledger_that_cannot_be_written_ends_with_4(tmp_path: Path) -> None:
    line = tmp_path / "line.toml"
    line.write_text(
        '[line]\nname = "b"\n[[station]]\nname = "dde-1"\nurl = "/dev/x"\nfamily = "dde"\n',
        encoding="utf-8",
    )
    ended = call("done", "-s", "dde-1", *DONE, "--ledger", "/proc/counters.jsonl", "--line", line)
    assert (ended.exit_code, ended.stdout) == (4, "")
    assert "/proc/counters.jsonl cannot be written" in ended.stderr


# -- why a counter fell ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("task", "fell_to", "rule"),
    [
        ("counters-reset", 7.0, "stated_reset"),
        ("counters-rolled-over", 7.0, "rolled_over"),
        ("station-replaced", 7.0, "stated_replaced"),
        ("counters-reset", 900.0, "fell"),  # more than in a day since a reset: not believed
    ],
)
def test_the_command_of_the_question_records_the_answer(
    tmp_path: Path, task: str, fell_to: float, rule: str
) -> None:
    ledger, later = tmp_path / "counters.jsonl", "2026-11-22T06:17:00.000+00:00"
    looks = [
        Observation(
            time, time, "bench-3", "dde 1", "/dev/x", True, counts=(Count(1, "work_h", "h", value),)
        )
        for time, value in ((AT, 99_990.0), (later, fell_to))
    ]
    add(ledger, looks)
    question = fleet_of(read_book(ledger), looks[1:], later).stations[0].question
    command = shlex.split(question.partition("`jbclog maintenance ")[2].partition("`")[0])
    assert command == ["done", "--station", "dde 1", "--at", later, "--task"]
    assert task in question.partition("`jbclog")[2]
    assert call(*command, task, "--ledger", ledger).exit_code == 0
    (station,) = fleet_of(read_book(ledger), looks[1:], later).stations
    assert [mark.rule for mark in station.meters[0].counter_total.marks] == [rule]
    assert (station.question == "") == (rule != "fell")


@pytest.mark.parametrize("at", [(), ("--at", "2026-11-20"), ("--at", "2026-11-23")])
def test_an_answer_at_another_time_than_the_fall_is_refused(
    tmp_path: Path, at: tuple[str, ...]
) -> None:
    """It would answer nothing, and the next audit would count it as a reset of its own."""
    ledger, later = tmp_path / "counters.jsonl", "2026-11-22T06:17:00.000+00:00"
    looks = [
        Observation(
            time, time, "bench-3", "dde-1", "/dev/x", True, counts=(Count(1, "work_h", "h", value),)
        )
        for time, value in ((AT, 99_990.0), (later, 7.0))
    ]
    add(ledger, looks)
    before = ledger.read_bytes()
    words = ["done", "--station", "dde-1", "--task", "counters-reset", "--ledger", ledger, *at]
    ended = call(*words)
    assert ended.exit_code == 2
    assert f"give --at {later}. Nothing was added" in ended.stderr
    assert ledger.read_bytes() == before
