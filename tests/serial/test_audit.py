"""`jbclog audit` on real pseudo-terminals: nothing is written, a run is left alone, and what was read is kept whatever happens."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from command import BENCH, RECIPE, WireLog, is_sampling, jbclog, started, until
from small_disk import small_disk
from typer.testing import CliRunner, Result

from jbclog.audit.book import auditing, read_book
from jbclog.audit.observed import Observation, Standing
from jbclog.cli.app import app
from jbclog.counting import looking
from jbclog.sim.process import SimProcess

Bench = tuple[Path, WireLog]
STATIONS = ("dde-1", "ucr-1", "ale-1", "dde-2")


def audit(line: Path, ledger: Path, *more: str | Path) -> Result:
    """A call in this process: the ports are real all the same."""
    words = ("audit", "--line", line, "--ledger", ledger, *more)
    return CliRunner().invoke(app, list(map(str, words)))


def observed(ledger: Path) -> dict[str, Observation]:
    """The last of each station."""
    return {one.station: one for one in read_book(ledger).observations}


def test_every_station_is_read_and_none_written_or_cleared(bench: Bench, tmp_path: Path) -> None:
    line, wire = bench
    ledger = tmp_path / "counters.jsonl"
    ended = audit(line, ledger, "--csv", tmp_path / "a.csv", "--html", tmp_path / "a.html")
    assert ended.exit_code == 0, ended.stderr
    seen = observed(ledger)
    assert {(one.seen, one.source) for one in seen.values()} == {(True, "wire")}
    assert [count.standing for one in seen.values() for count in one.counts if count.standing is not Standing.OK] == []
    for name in seen:
        asked = wire.questions(name)
        assert len(asked) > 20
        assert {text[0] for text in asked} == {"R"}
        assert [text for text in asked if text.startswith("RTA")] == []
    assert not (tmp_path / "counters.jsonl.lock").exists()
    assert (tmp_path / "a.html").read_text(encoding="utf-8").startswith("<!")
    assert (tmp_path / "a.csv").read_text(encoding="utf-8-sig").startswith("schema,audit,line,station,")


def test_two_audits_in_a_row_agree(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    ledger = tmp_path / "counters.jsonl"
    assert audit(line, ledger).exit_code == 0
    ended = audit(line, ledger, "--json")
    assert ended.exit_code == 0, ended.stderr
    told = json.loads(ended.stdout)
    assert (told["exit_code"], told["trouble"], len(told["stations"])) == (0, [], 4)
    assert {one["audits"] for one in told["stations"]} == {2}
    kinds = {meter["last"]["kind"] for one in told["stations"] for meter in one["meters"]}
    assert kinds <= {"zero", "normal"}


def test_a_run_is_left_alone_and_its_record_read(bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line, wire = bench
    ledger, out = tmp_path / "counters.jsonl", tmp_path / "runs"
    run = started("run", RECIPE, "--line", line, "--out", out, "-d", "60s", "-s", "ucr-1")
    try:
        assert until(lambda: is_sampling(out))
        (folder,) = out.iterdir()
        ended = audit(line, ledger)
        assert ended.exit_code == 0, ended.stderr
        _began_meanwhile(monkeypatch)
        assert audit(line, ledger).exit_code == 0
    finally:
        run.terminate()
        _, notes = run.communicate(timeout=20)
    assert run.returncode == 143, notes
    first, second = [one for one in read_book(ledger).observations if one.station == "ucr-1"]
    for one in (first, second):
        assert (one.seen, one.source) == (True, f"run:{folder}")
        assert one.identity is not None
        assert (one.identity.model, {count.standing for count in one.counts}) == ("UCR245", {Standing.OK})
        assert {"dispensed_mm", "work_h"} <= {count.counter for count in one.counts}
        assert one.parameters["1.sleep_delay"] == "5"
        assert (one.errors.station, one.errors.ports) == ("ok", {1: "ok"})
    assert observed(ledger)["dde-1"].source == "wire"
    assert wire.questions("ucr-1").count("RSMN") == 2  # the run's own


def _began_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if each run began between the look for runs and the opening of the port: the lock decides."""
    real, looks = looking.run_that_holds, []

    def holds(url: str) -> Path | None:
        looks.append(url)
        return real(url) if looks.count(url) > 1 else None

    monkeypatch.setattr(looking, "run_that_holds", holds)


def test_a_run_without_counters_yet_says_when_to_try_again(bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line, _ = bench
    folder = tmp_path / "runs" / "20261121T013000Z-bench-abcd"
    folder.mkdir(parents=True)
    monkeypatch.setattr(looking, "run_that_holds", lambda url: folder if url.endswith("dde-1") else None)
    ended = audit(line, tmp_path / "counters.jsonl")
    assert ended.exit_code == 3
    assert f"dde-1: the run {folder} has this station, and has not asked it yet; it was left alone. Audit again" in ended.stderr
    assert not observed(tmp_path / "counters.jsonl")["dde-1"].seen


def test_what_some_stations_said_is_kept_when_others_do_not_answer(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    (line.parent / "ucr-1").unlink()
    ended = audit(line, tmp_path / "counters.jsonl", "--csv", tmp_path / "a.csv", "--json")
    assert ended.exit_code == 3
    assert json.loads(ended.stdout)["exit_code"] == 3
    assert "there is no such port; see that it is plugged in" in ended.stderr
    seen = observed(tmp_path / "counters.jsonl")
    assert {name: one.seen for name, one in seen.items()} == {"dde-1": True, "ucr-1": False, "ale-1": True, "dde-2": True}
    assert "ucr-1" in (tmp_path / "a.csv").read_text(encoding="utf-8")
    assert audit(line, tmp_path / "counters.jsonl", "--fail-on", "due").exit_code == 0


def test_one_audit_at_a_time(bench: Bench, tmp_path: Path) -> None:
    line, wire = bench
    ledger = tmp_path / "counters.jsonl"
    with auditing(ledger):
        ended = audit(line, ledger)
    assert ended.exit_code == 2
    assert "another audit" in ended.stderr
    assert [wire.questions(name) for name in STATIONS] == [[]] * 4
    assert not ledger.exists()


def test_a_damaged_ledger_is_told_and_still_added_to(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    ledger = tmp_path / "counters.jsonl"
    audit(line, ledger)
    ledger.write_bytes(ledger.read_bytes().replace(b'"dde-1"', b'"dde-9"', 1))
    ended = audit(line, ledger)
    assert ended.exit_code == 4
    assert f"{ledger}: line" in ended.stderr
    assert "fine" in ended.stdout
    assert len(ledger.read_bytes().splitlines()) == 8


def test_a_ledger_that_cannot_be_written_takes_nothing_from_what_is_told(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    ended = audit(line, Path("/proc/counters.jsonl"), "--json", "--csv", tmp_path / "a.csv")
    assert ended.exit_code == 4
    told = json.loads(ended.stdout)
    assert [one["seen"] for one in told["stations"]] == [True] * 4
    assert "/proc/counters.jsonl" in told["trouble"][0]
    assert "work_h" in (tmp_path / "a.csv").read_text(encoding="utf-8")


def test_a_full_disk_takes_nothing_from_what_is_told(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    with small_disk(tmp_path / "disk", "64k") as disk:
        (disk / "filler").write_bytes(bytes((64 << 10) - os.sysconf("SC_PAGE_SIZE")))
        ended = audit(line, disk / "counters.jsonl", "--json")
        kept = read_book(disk / "counters.jsonl")
    assert ended.exit_code == 4
    assert all(one["seen"] for one in json.loads(ended.stdout)["stations"])
    assert "No space left" in ended.stderr
    assert kept.is_sound


def test_ctrl_c_leaves_what_was_read_in_the_ledger(tmp_path: Path) -> None:
    ledger, source = tmp_path / "counters.jsonl", tmp_path / "source.toml"
    tables = (f'[[station]]\nname = "d-{one}"\nurl = "d-{one}"\nfamily = "dde"\n' for one in range(20))
    source.write_text('[line]\nname = "l"\n' + "".join(tables), encoding="utf-8")
    with SimProcess(source, tmp_path / "served") as stations:
        process = started("audit", "--line", stations.line_path, "--ledger", ledger, "--json")
        assert until(lambda: ledger.exists() and len(ledger.read_bytes()) > 0)
        process.send_signal(signal.SIGINT)
        out, notes = process.communicate(timeout=20)
    book = read_book(ledger)
    assert book.wrong == []
    assert 0 < len(book.observations) < 20
    told = json.loads(out)
    assert {one["station"] for one in told["stations"] if one["seen"]} == {one.station for one in book.observations}
    assert "stopped before it was asked" in out
    assert process.returncode == told["exit_code"] == 130, notes


def test_stations_behind_one_port_are_asked_one_after_the_other(tmp_path: Path) -> None:
    """Two line files name the same wire; what is no address of it does not answer, and costs seconds."""
    with SimProcess(BENCH, tmp_path / "bench") as stations:
        text = stations.line_path.read_text(encoding="utf-8")
        served = stations.line_path.parent / "dde-1"
        other = tmp_path / "other.toml"
        other.write_text(f'[line]\nname = "other"\n[[station]]\nname = "dde-7"\nurl = "{served}"\nfamily = "dde"\naddress = 7\n')
        ended = audit(stations.line_path, tmp_path / "counters.jsonl", "--line", other)
    assert "dde-1" in text
    assert ended.exit_code == 3
    seen = observed(tmp_path / "counters.jsonl")
    assert (seen["dde-1"].seen, seen["dde-7"].seen) == (True, False)
    assert "in use" not in seen["dde-7"].why
    assert "no usable answer" in seen["dde-7"].why


def test_the_ledger_is_shared_with_maintenance(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    ledger = tmp_path / "counters.jsonl"
    done = ("maintenance", "done", "--station", "dde-1", "--task", "tip-change", "--tip", "T-17", "-p", "1", "--by", "A. Rossi")
    assert audit(line, ledger).exit_code == 0
    told = jbclog(*done, "--ledger", ledger)
    assert (told.returncode, told.stderr) == (0, "")
    assert "dde-1 port 1  tip-change  T-17  by A. Rossi  kept as line 5" in told.stdout
    assert audit(line, ledger).exit_code == 0
    assert read_book(ledger).wrong == []
