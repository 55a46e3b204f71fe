"""`jbclog audit` on real pseudo-terminals: it writes nothing, does not disturb a run, and keeps its
readings whatever happens.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pytest
from typer.testing import Result

from support.command import RECIPE, WireLog, expect_terminated, is_sampling, started, until
from support.faults.small_disk import small_disk
from support.invoked import invoked
from support.product import (
    EventRow,
    Given,
    LineFile,
    Manifest,
    Observation,
    Port,
    PortAccess,
    Severity,
    SimProcess,
    Standing,
    StationFacts,
    SurveyTarget,
    auditing,
    keep_verification,
    open_for_survey,
    open_run,
    open_store,
    own_verification,
    patch,
    read_counter_book,
    run_that_holds,
    verify_tip,
    write_manifest,
)

pytestmark = pytest.mark.usefixtures("patient")

STATIONS = ("dde-1", "ucr-1", "jtse-1")
SOURCE = '[line]\nname = "bench"\n' + "".join(
    f'[[station]]\nname = "{name}"\nurl = "{name}"\nfamily = "{name[:-2]}"\n[station.sim]\nwire ='
    f" false\ntool = {tool}\n"
    for name, tool in (("dde-1", 2), ("ucr-1", 9), ("jtse-1", 1))
)


class Bench:
    """Three virtual stations without pacing, shared by all tests here. `questions` returns those
    since the start of the test.
    """

    def __init__(self, line: Path, log: WireLog) -> None:
        self.line = line
        self._log = log
        self._before = {name: len(log.questions(name)) for name in STATIONS}

    def questions(self, name: str) -> list[str]:
        return self._log.questions(name)[self._before[name] :]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, WireLog]]:
    folder = tmp_path_factory.mktemp("served")
    (folder / "source.toml").write_text(SOURCE, encoding="utf-8")
    with SimProcess(
        folder / "source.toml", folder / "bench", log=folder / "wire.jsonl"
    ) as stations:
        yield stations.line_path, WireLog(folder / "wire.jsonl")


@pytest.fixture
def bench(served: tuple[Path, WireLog]) -> Bench:
    return Bench(*served)


def audit(line: Path, ledger: Path, *more: str | Path) -> Result:
    """Audit from this process; the ports are real."""
    words = ("audit", "--line", line, "--ledger", ledger, *more)
    return invoked(*words)


def observed(ledger: Path) -> dict[str, Observation]:
    """Return the last observation of each station."""
    return {one.station: one for one in read_counter_book(ledger).observations}


def test_every_station_is_read_and_none_written_or_cleared(bench: Bench, tmp_path: Path) -> None:
    ledger = tmp_path / "counters.jsonl"
    ended = audit(bench.line, ledger, "--csv", tmp_path / "a.csv", "--html", tmp_path / "a.html")
    assert ended.exit_code == 0, ended.stderr
    seen = observed(ledger)
    assert {(one.seen, one.source) for one in seen.values()} == {(True, "wire")}
    assert [
        count.standing
        for one in seen.values()
        for count in one.counts
        if count.standing is not Standing.OK
    ] == []
    for name in seen:
        asked = bench.questions(name)
        assert len(asked) > 20
        assert {text[0] for text in asked} == {"R"}
        assert [text for text in asked if text.startswith("RTA")] == []
    assert not (tmp_path / "counters.jsonl.lock").exists()
    assert (tmp_path / "a.html").read_text(encoding="utf-8").startswith("<!")
    assert (
        (tmp_path / "a.csv")
        .read_text(encoding="utf-8-sig")
        .startswith("schema,audit,line,station,")
    )


def test_for_cron_it_says_nothing_where_all_is_fine(bench: Bench, tmp_path: Path) -> None:
    ended = audit(bench.line, tmp_path / "counters.jsonl", "--quiet")
    assert (ended.exit_code, ended.output) == (0, "")
    tasks = tmp_path / "tasks.toml"
    tasks.write_text('[[task]]\nname = "old"\nlife_days = 30\n', encoding="utf-8")
    done = (
        "maintenance",
        "done",
        "-s",
        "dde-1",
        "--task",
        "old",
        "--at",
        "2024-01-01",
        "--by",
        "W",
    )
    invoked(*done, "--tasks", tasks, "--ledger", tmp_path / "counters.jsonl")
    ended = audit(bench.line, tmp_path / "counters.jsonl", "--quiet", "--tasks", tasks)
    assert ended.exit_code == 1
    assert "OVERDUE" in ended.stdout


def test_two_audits_in_a_row_agree(bench: Bench, tmp_path: Path) -> None:
    ledger = tmp_path / "counters.jsonl"
    assert audit(bench.line, ledger).exit_code == 0
    ended = audit(bench.line, ledger, "--json")
    assert ended.exit_code == 0, ended.stderr
    told = json.loads(ended.stdout)
    assert (told["exit_code"], told["trouble"], len(told["stations"])) == (0, [], 3)
    assert {one["audits"] for one in told["stations"]} == {2}
    kinds = {meter["last"]["kind"] for one in told["stations"] for meter in one["meters"]}
    assert kinds <= {"zero", "normal"}


def test_a_run_is_left_alone_and_its_record_read(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ledger, out, opened = tmp_path / "counters.jsonl", tmp_path / "runs", list[str]()
    _note_opened(monkeypatch, opened)
    run = started("run", RECIPE, "--line", bench.line, "--out", out, "-d", "600s", "-s", "ucr-1")
    try:
        assert until(lambda: is_sampling(out) and has_errors(out))
        (folder,) = out.iterdir()
        ended = audit(bench.line, ledger)
        assert ended.exit_code == 0, ended.stderr
        _began_meanwhile(monkeypatch)
        assert audit(bench.line, ledger).exit_code == 0
        expect_terminated(run)
    finally:
        run.kill()
        run.communicate(timeout=200)
    first, second = [
        one for one in read_counter_book(ledger).observations if one.station == "ucr-1"
    ]
    for one in (first, second):
        assert (one.seen, one.source) == (True, f"run:{folder}")
        assert one.identity is not None
        assert (one.identity.model, {count.standing for count in one.counts}) == (
            "UCR245",
            {Standing.OK},
        )
        assert {"dispensed_mm", "work_h"} <= {count.counter for count in one.counts}
        assert one.parameters["1.sleep_delay"] == "5"
        assert (one.errors.station, one.errors.ports) == ("ok", {1: "ok"})
    assert observed(ledger)["dde-1"].source == "wire"
    assert sorted(opened) == ["dde-1", "dde-1", "jtse-1", "jtse-1"]


def has_errors(out: Path) -> bool:
    """Whether the run has read the station's error, which is due every five seconds."""
    (run,) = out.iterdir()
    return bool(open_run(run).samples(columns=["station_error"])["station_error"].notna().any())


def _note_opened(monkeypatch: pytest.MonkeyPatch, opened: list[str]) -> None:
    """Add the station of each port that the audits open to `opened`."""
    real = open_for_survey

    def noted(wanted: SurveyTarget, access: PortAccess) -> Port:
        port = real(wanted, access)
        opened.append(wanted.target.name)
        return port

    patch(monkeypatch, "survey._open", noted)


def _began_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulate runs that begin between the search for runs and the opening of the port: the lock
    decides.
    """
    real, looks = run_that_holds, []

    def holds(url: str) -> Path | None:
        looks.append(url)
        return real(url) if looks.count(url) > 1 else None

    patch(monkeypatch, "survey.run_that_holds", holds)


def test_a_run_without_counters_yet_says_when_to_try_again(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "runs" / "20261121T013000Z-bench-abcd"
    folder.mkdir(parents=True)
    patch(
        monkeypatch, "survey.run_that_holds", lambda url: folder if url.endswith("dde-1") else None
    )
    ended = audit(bench.line, tmp_path / "counters.jsonl")
    assert ended.exit_code == 3
    assert (
        f"dde-1: the run {folder} holds this station and has not asked it yet; it was not read."
        " Audit again" in ended.stderr
    )
    assert not observed(tmp_path / "counters.jsonl")["dde-1"].seen


def test_what_some_stations_said_is_kept_when_others_do_not_answer(
    bench: Bench, tmp_path: Path
) -> None:
    lost = tmp_path / "line.toml"
    lost.write_text(SOURCE.replace('url = "ucr-1"', 'url = "gone"'), encoding="utf-8")
    for name in STATIONS:
        (tmp_path / name).symlink_to((bench.line.parent / name).resolve())
    ended = audit(lost, tmp_path / "counters.jsonl", "--csv", tmp_path / "a.csv", "--json")
    assert ended.exit_code == 3
    assert json.loads(ended.stdout)["exit_code"] == 3
    assert "no such port; check that it is plugged in" in ended.stderr
    seen = observed(tmp_path / "counters.jsonl")
    assert {name: one.seen for name, one in seen.items()} == {
        "dde-1": True,
        "ucr-1": False,
        "jtse-1": True,
    }
    assert "ucr-1" in (tmp_path / "a.csv").read_text(encoding="utf-8")
    assert audit(lost, tmp_path / "counters.jsonl", "--fail-on", "due").exit_code == 0


def test_one_audit_at_a_time(bench: Bench, tmp_path: Path) -> None:
    ledger = tmp_path / "counters.jsonl"
    with auditing(ledger):
        ended = audit(bench.line, ledger)
    assert ended.exit_code == 2
    assert "another audit" in ended.stderr
    assert [bench.questions(name) for name in STATIONS] == [[]] * 3
    assert not ledger.exists()


def test_a_damaged_ledger_is_told_and_still_added_to(bench: Bench, tmp_path: Path) -> None:
    ledger = tmp_path / "counters.jsonl"
    audit(bench.line, ledger)
    ledger.write_bytes(ledger.read_bytes().replace(b'"dde-1"', b'"dde-9"', 1))
    ended = audit(bench.line, ledger)
    assert ended.exit_code == 4
    assert f"{ledger}: line" in ended.stderr
    assert "DDE 1.00a" in ended.stdout
    assert len(ledger.read_bytes().splitlines()) == 6


def test_a_ledger_that_cannot_be_written_takes_nothing_from_what_is_told(
    bench: Bench, tmp_path: Path
) -> None:
    ended = audit(bench.line, Path("/proc/counters.jsonl"), "--json", "--csv", tmp_path / "a.csv")
    assert ended.exit_code == 4
    told = json.loads(ended.stdout)
    assert [one["seen"] for one in told["stations"]] == [True] * 3
    assert "/proc/counters.jsonl" in told["trouble"][0]
    assert "work_h" in (tmp_path / "a.csv").read_text(encoding="utf-8")


def test_a_page_of_what_is_not_in_the_ledger_says_so(bench: Bench, tmp_path: Path) -> None:
    """The first audit would be a baseline, but there is none to count from."""
    os.mkfifo(tmp_path / "counters.jsonl")
    ended = audit(bench.line, tmp_path / "counters.jsonl", "--html", tmp_path / "a.html")
    assert ended.exit_code == 4
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "counters.jsonl cannot be read: is a pipe, not a file" in page
    for told in (ended.stdout, page):
        assert "NOT KEPT IN THE LEDGER" in told or "OVERDUE" in told
        assert "their use counts from here" not in told


def test_a_full_disk_takes_nothing_from_what_is_told(bench: Bench, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "64k") as disk:
        (disk / "filler").write_bytes(bytes(64 << 10))
        ended = audit(bench.line, disk / "counters.jsonl", "--json")
        kept = read_counter_book(disk / "counters.jsonl")
    assert ended.exit_code == 4
    assert all(one["seen"] for one in json.loads(ended.stdout)["stations"])
    assert "No space left" in ended.stderr
    assert kept.is_sound


def test_ctrl_c_leaves_what_was_read_in_the_ledger(tmp_path: Path) -> None:
    ledger, source = tmp_path / "counters.jsonl", tmp_path / "source.toml"
    tables = (
        f'[[station]]\nname = "d-{one}"\nurl = "d-{one}"\nfamily = "dde"\n[station.sim]\n'
        f"turnaround_ms = {1 if one == 0 else 150}\n"  # so that the others go on for long
        for one in range(16)
    )
    source.write_text('[line]\nname = "l"\n' + "".join(tables), encoding="utf-8")
    with SimProcess(source, tmp_path / "served") as stations:
        process = started("audit", "--line", stations.line_path, "--ledger", ledger, "--json")
        assert until(lambda: ledger.exists() and len(ledger.read_bytes()) > 0)
        process.send_signal(signal.SIGINT)
        out, notes = process.communicate(timeout=200)
    book = read_counter_book(ledger)
    assert book.wrong == []
    assert 0 < len(book.observations) < 16
    told = json.loads(out)
    assert {one["station"] for one in told["stations"] if one["seen"]} == {
        one.station for one in book.observations
    }
    assert "stopped before this station was read" in out
    assert process.returncode == told["exit_code"] == 130, notes


def test_stations_behind_one_port_are_asked_one_after_the_other(
    bench: Bench, tmp_path: Path
) -> None:
    """Another line file names the same port with an address that has no station; the missing
    answers take seconds.
    """
    other, port = tmp_path / "other.toml", bench.line.parent / "dde-1"
    other.write_text(
        f'[line]\nname = "other"\n[[station]]\nname = "dde-7"\nurl = "{port}"\nfamily ='
        ' "dde"\naddress = 7\n'
    )
    ended = audit(bench.line, tmp_path / "counters.jsonl", "--line", other)
    assert ended.exit_code == 3
    seen = observed(tmp_path / "counters.jsonl")
    assert (seen["dde-1"].seen, seen["dde-7"].seen) == (True, False)
    assert "no usable answer" in seen["dde-7"].why  # and not that the port is in use


def test_the_ledger_is_shared_with_maintenance(bench: Bench, tmp_path: Path) -> None:
    ledger = tmp_path / "counters.jsonl"
    done = (
        "maintenance",
        "done",
        "--station",
        "dde-1",
        "--task",
        "tip-change",
        "--tip",
        "T-17",
        "-p",
        "1",
        "--by",
        "A. Rossi",
    )
    assert audit(bench.line, ledger).exit_code == 0
    told = invoked(*done, "--ledger", ledger)
    assert (told.exit_code, told.stderr) == (0, "")
    assert "dde-1 port 1  tip-change  A. Rossi  T-17  (line 4" in told.stdout
    assert audit(bench.line, ledger).exit_code == 0
    assert read_counter_book(ledger).wrong == []


@pytest.mark.parametrize(
    ("option", "file", "says"),
    [
        ("--csv", "counters.jsonl", "would overwrite"),
        ("--html", "bench/../counters.jsonl", "would overwrite"),
        ("--csv", "line.toml", "would overwrite"),
        ("--csv", "-", "--json writes to stdout"),
        ("--html", "to_null", "device or link"),
        ("--html", "bench", "folder"),
        ("--html", "gone/a.html", "no such folder"),
    ],
)
def test_nothing_but_a_page_is_written_over(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: str, file: str, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bench").mkdir()
    (tmp_path / "to_null").symlink_to("/dev/null")
    (tmp_path / "counters.jsonl").write_bytes(b"")
    copied = tmp_path / "line.toml"
    copied.write_text(bench.line.read_text(encoding="utf-8"), encoding="utf-8")
    ended = audit(copied, Path("counters.jsonl"), option, file)
    assert (ended.exit_code, says in ended.stderr) == (2, True), ended.stderr
    assert [bench.questions(name) for name in STATIONS] == [[]] * 3


@pytest.mark.parametrize(
    ("file", "says"), [("pipe", "is a pipe"), ("folder", "is a folder"), ("link", "is a link")]
)
def test_a_ledger_that_is_no_file_takes_nothing_from_what_is_told(
    bench: Bench, tmp_path: Path, file: str, says: str
) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("elsewhere.jsonl")
    ended = audit(bench.line, tmp_path / file, "--json")
    assert ended.exit_code == 4
    told = json.loads(ended.stdout)
    assert [one["seen"] for one in told["stations"]] == [True] * 3
    assert f"{tmp_path / file} cannot be " in told["trouble"][0]
    assert says in told["trouble"][0]
    assert not (tmp_path / "elsewhere.jsonl").exists()


def test_what_is_no_ledger_is_never_added_to(bench: Bench, tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text('[line]\nname = "other"\n', encoding="utf-8")
    ended = audit(bench.line, other, "--json")
    assert ended.exit_code == 4
    assert json.loads(ended.stdout)["trouble"] == [
        f"{other} is not a ledger: none of its lines is valid. Nothing was added; name another file"
    ]
    done = (
        "maintenance",
        "done",
        "-s",
        "dde-1",
        "--task",
        "service",
        "--by",
        "W",
        "--line",
        str(bench.line),
    )
    assert invoked(*done, "--ledger", other).exit_code == 4
    assert other.read_text(encoding="utf-8") == '[line]\nname = "other"\n'


def test_what_runs_saw_since_last_time_counts_once(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch(monkeypatch, "audit_records.LAG", timedelta(0))
    ledger, out = tmp_path / "counters.jsonl", tmp_path / "runs"
    tasks = tmp_path / "tasks.toml"
    tasks.write_text(
        '[[task]]\nname = "verification"\nlife_days = 30\nstations = ["dde-1"]\n', encoding="utf-8"
    )
    ended = audit(bench.line, ledger, "--runs", out, "--tasks", tasks)
    assert (ended.exit_code, f"{out}: no such folder" in ended.stderr) == (4, True)
    assert f"no verification in {out / 'verifications.jsonl'} or the ledger" in ended.stdout
    _a_run_with_an_error(out)
    _a_verification(out)
    ended = audit(bench.line, ledger, "--runs", out, "--tasks", tasks)
    assert (ended.exit_code, ended.stderr) == (0, "")
    assert "since the last audit, from runs: 1 port.error" in ended.stdout
    assert f"port 1 verified by W, PASS: line 1 of {out / 'verifications.jsonl'}" in ended.stdout
    assert observed(ledger)["dde-1"].errors.events == {"port.error": 1}
    assert observed(ledger)["ucr-1"].errors.events is None
    assert "since the last audit" not in audit(bench.line, ledger, "--runs", out).stdout


def _a_run_with_an_error(out: Path) -> None:
    folder = out / "20261121T013000Z-bench-abcd"
    folder.mkdir(parents=True)
    line = LineFile("bench", "line.toml", "0" * 64)
    stations = [StationFacts("dde-1", "url", "dde", "DDE", "1", ports=[1], tool_names={})]
    write_manifest(
        folder,
        Manifest(folder.name, start="2026-11-21T01:30:00.000000Z", line=line, stations=stations),
    )
    store = open_store(folder, seal_every_s=None)
    store.start()
    store.event(
        EventRow(int(time.time() * 1e6), "port.error", Severity.ERROR, "it happened", "dde-1", 1)
    )
    store.commit_now()
    store.close()
    store.release()


def _a_verification(out: Path) -> None:
    given = Given("dde-1", 1, 351.0, "TC-7", date(2127, 3, 1), "T-17", "W")
    keep_verification(
        out, verify_tip(given, own_verification([350.0] * 12, 350.0), datetime.now(UTC))
    )
