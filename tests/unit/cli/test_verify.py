"""`jbclog verify` and `jbclog where-used`: a tip read by virtual stations in memory, and runs
recorded on a clock that jumps.
"""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pytest

from jbclog.core.rows import StationFacts
from jbclog.maintenance.verification import NAME, Given, keep, own_of, read_book, verify
from jbclog.record.manifest import LineFile, Manifest, Metadata, iso, write_manifest
from support.faults.hostile_names import HOSTILE, MOVES
from support.invoked import invoked
from support.virtual.manual import Bench, Ended, Make, says, station_text

SAID = ("--instrument", "TC-7", "--due", "2099-03-01", "--tip", "T-17", "--by", "A. Rossi")


@pytest.fixture
def bench(make: Make) -> Bench:
    """A station whose tip is 12 °C colder than it says, at work and settled."""
    made = make(
        station_text(
            "dde-1", "dde", "", "tools = { 1 = 2 }\nsensor_error_c = 12\njoints_per_minute = 0"
        )
    )
    assert made.do("write", "dde-1", "status", "working", "--port", "1").code == 0
    made.wait(60)
    made.wires["dde-1"].heard.clear()
    return made


def verified(bench: Bench, reading: str, *words: str) -> Ended:
    return bench.do("verify", "dde-1", "-p", "1", "--reading", reading, *SAID, *words)


def test_it_reads_the_station_itself_and_writes_nothing(bench: Bench) -> None:
    ended = verified(bench, "338")
    assert ended.code == 0, ended.err
    assert ended.out.startswith(
        "PASS  dde-1 port 1, tip T-17: The tip is -12.0 °C from the station's own reading and"
        " -12.0 °C"
    )
    (kept,) = read_book(Path("runs")).entries
    assert (kept.station_c, kept.station_n, kept.setpoint_c, kept.adjust_c, kept.offset_c) == (
        350.0,
        12,
        350.0,
        0.0,
        -12.0,
    )
    assert (kept.tool_name, kept.model, kept.by) == ("T245/T470/TR245/TR470", "DDE", "A. Rossi")
    assert bench.wires["dde-1"].writes == []
    # each reading is borne out by a second answer
    assert bench.wires["dde-1"].texts.count("RTT1") == 24


def test_a_temperature_that_cannot_be_is_no_reading_and_one_said_once_is_none_either(
    bench: Bench,
) -> None:
    says(bench, "dde-1", "TT1", "04033")
    assert verified(bench, "338").code == 0
    says(bench, "dde-1", "TT1", "04033", last=True)
    ended = verified(bench, "338")
    assert ended.code == 3
    assert "its tip could not be read: the station says 4033 °C, which is impossible" in ended.err


def test_the_proposal_is_a_call_that_makes_the_next_one_pass(bench: Bench) -> None:
    ended = verified(bench, "334")
    assert ended.code == 1
    call = (
        next(line for line in ended.err.splitlines() if line.startswith("proposed"))
        .partition(": ")[2]
        .partition("   (")[0]
    )
    assert "16" in call
    assert bench.call(call).code == 0
    bench.wait(60)
    # as the thermometer would show now: the tip is 16 °C hotter
    assert verified(bench, "350").code == 0
    assert [one.adjust_c for one in read_book(Path("runs")).entries] == [0.0, 16.0]


def test_a_downward_proposal_can_be_typed_as_it_is_told(bench: Bench) -> None:
    ended = verified(bench, "362.4")
    call = json.loads(verified(bench, "362.4", "--json").out)["proposed_call"]
    assert call in ended.err
    assert bench.call(call).code == 0
    assert bench.wires["dde-1"].writes == ["WA12-0012"]


def test_a_tip_that_rests_is_refused_and_nothing_is_kept(bench: Bench) -> None:
    bench.do("write", "dde-1", "status", "stand", "--port", "1")
    ended = verified(bench, "350")
    assert (ended.code, Path("runs").exists()) == (3, False)
    assert "not working" in ended.err


def test_a_tip_that_is_still_heating_is_refused(make: Make) -> None:
    made = make(station_text("dde-1", "dde", "", "tools = { 1 = 2 }"))
    made.do("write", "dde-1", "status", "working", "--port", "1")
    ended = verified(made, "350")
    assert (ended.code, "is not stable" in ended.err) == (3, True)


def test_a_port_without_a_tool_and_one_that_is_not_there_are_refused(make: Make) -> None:
    made = make(station_text("dde-1", "dde", "", "tool = 0"))
    assert "no tool in port 1" in verified(made, "350").err
    assert made.do("verify", "dde-1", "-p", "4", "--reading", "350", *SAID).code == 3


def test_a_display_that_was_read_is_enough_and_the_station_is_not_asked(bench: Bench) -> None:
    ended = verified(bench, "349", "--station-c", "350")
    assert (ended.code, bench.wires["dde-1"].heard) == (0, [])
    assert "from its display" in ended.out


def test_an_instrument_past_its_due_date_makes_it_invalid(bench: Bench) -> None:
    ended = bench.do(
        "verify",
        "dde-1",
        "-p",
        "1",
        "--reading",
        "350",
        *SAID[:2],
        "--due",
        "2001-01-01",
        *SAID[4:],
    )
    assert (ended.code, ended.out[:7]) == (1, "INVALID")
    assert "proposed" not in ended.err


@pytest.mark.parametrize(
    "words",
    [
        ("--reading", "2000"),
        ("--due", "soon"),
        ("--limit", "0"),
        ("--by", " "),
        ("--tip", "a\u202eb"),
        ("--port", "7"),
    ],
)
def test_wrong_usage_asks_and_keeps_nothing(bench: Bench, words: tuple[str, str]) -> None:
    ended = verified(bench, "350", *words)
    assert (ended.code, bench.wires["dde-1"].heard, Path("runs").exists()) == (2, [], False)


# -- where it was used -----------------------------------------------------------------------------

NOW = datetime(2026, 11, 21, 8, 0, tzinfo=UTC)


def checked(out: Path, day: float, result: str, **more: object) -> None:
    given = Given(
        "dde-1",
        1,
        400.0 if result == "fail" else 350.0,
        "TC-7",
        date(2099, 1, 1),
        "T-17",
        "A. Rossi",
    )
    one = verify(replace(given, **more), own_of([350.0] * 12, 350.0), NOW + timedelta(days=day))  # type: ignore[arg-type]
    assert one.result == result
    keep(out, one)


def ran(out: Path, day: float, hours: float = 1.0, **said: object) -> str:
    """A sealed run that began then; only its manifest."""
    began = NOW + timedelta(days=day)
    folder = out / f"{began:%Y%m%dT%H%M%SZ}-bench-aaaa"
    folder.mkdir(parents=True)
    at = [iso(int(moment.timestamp() * 1e6)) for moment in (began, began + timedelta(hours=hours))]
    facts = StationFacts("dde-1", "x", "dde", ports=[1, 2])
    line, metadata = LineFile("bench", "line.toml", "0"), Metadata(**said)  # type: ignore[arg-type]  # test helper
    write_manifest(
        folder,
        Manifest(
            folder.name,
            state="sealed",
            start=at[0],
            stop=at[1],
            line=line,
            stations=[facts],
            metadata=metadata,
        ),
    )
    return folder.name


def used(out: Path, *words: str) -> tuple[list[str], dict[str, object]]:
    ended = invoked("where-used", out, "--station", "dde-1", "--json", *words)
    told = json.loads(ended.stdout)
    return [run["run"] for run in told["runs"]], {**told, "code": ended.exit_code}


def test_the_runs_between_the_last_good_and_the_next_good_one_are_suspect(tmp_path: Path) -> None:
    for day, result in ((0, "pass"), (10, "pass"), (20, "fail"), (21, "fail"), (30, "pass")):
        checked(tmp_path, day, result)
    ran(tmp_path, 5)
    across = ran(tmp_path, 9.99)  # still on when it was verified
    between, behind = ran(tmp_path, 15, units=["SN-1", "SN-2"]), ran(tmp_path, 25)
    ran(tmp_path, 31)
    names, told = used(tmp_path)
    assert names == [across, between, behind]
    assert (told["since"], told["until"]) == (
        "2026-12-01T08:00:00+00:00",
        "2026-12-21T08:00:00+00:00",
    )
    assert told["runs"][1]["units"] == ["SN-1", "SN-2"]  # type: ignore[index]  # JSON


def test_a_run_that_names_another_tip_is_not_suspect_and_one_that_names_none_is(
    tmp_path: Path,
) -> None:
    checked(tmp_path, 0, "fail")
    ran(tmp_path, 1, tips=["dde-1:1=T-99"])
    silent, same = ran(tmp_path, 2), ran(tmp_path, 3, tips=["T-17"])
    assert used(tmp_path, "--tip", "T-17", "--port", "1")[0] == [silent, same]
    assert used(tmp_path, "--port", "2")[0] == []  # no verification of that port failed


def test_of_the_tip_that_failed_though_no_tip_was_asked_for_and_also_in_another_port(
    tmp_path: Path,
) -> None:
    checked(tmp_path, 0, "fail")
    ran(tmp_path, 1, tips=["dde-1:1=T-99", "dde-1:2=T-98"])
    moved = ran(tmp_path, 2, tips=["dde-1:1=T-99", "dde-1:2=T-17"])
    names, told = used(tmp_path)
    assert names == [moved]
    assert told["runs"][0]["ports"] == [2]  # type: ignore[index]  # JSON


def test_under_a_mistyped_name_nothing_is_cleared(tmp_path: Path) -> None:
    checked(tmp_path, 0, "fail")
    ran(tmp_path, 1)
    ended = invoked("where-used", tmp_path, "--station", "dde1")
    assert ended.exit_code == 2
    assert "dde1: no run in" in ended.stderr
    assert "known stations: dde-1" in ended.stderr


def test_another_tips_pass_does_not_clear_the_bad_one(tmp_path: Path) -> None:
    checked(tmp_path, 0, "pass")
    checked(tmp_path, 5, "fail")
    checked(tmp_path, 6, "pass", tip="T-18")
    run = ran(tmp_path, 8)
    assert used(tmp_path)[0] == [run]


def test_without_a_bad_one_a_time_must_be_asked_for(tmp_path: Path) -> None:
    checked(tmp_path, 0, "pass")
    ran(tmp_path, 1)
    late = ran(tmp_path, 3)
    assert used(tmp_path)[0] == []
    names, told = used(tmp_path, "--since", "2026-11-23")
    assert (names, told["code"]) == ([late], 0)


def test_what_cannot_be_read_is_told_and_ends_with_1(tmp_path: Path) -> None:
    checked(tmp_path, 0, "fail")
    name = ran(tmp_path, 1)
    (tmp_path / name / "manifest.json").write_text("{}")
    _, told = used(tmp_path)
    assert (told["code"], len(told["unreadable"])) == (1, 1)  # type: ignore[arg-type]  # JSON
    (tmp_path / NAME).write_text("nothing\n")
    assert used(tmp_path)[1]["code"] == 1


def test_without_a_known_verification_too_an_unreadable_run_is_named(tmp_path: Path) -> None:
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "manifest.json").write_text("{")
    ended = invoked("where-used", tmp_path, "--station", "dde-1")
    assert (
        ended.exit_code,
        "No verification is known." in ended.output,
        "torn: " in ended.output,
    ) == (1, True, True)


@pytest.mark.parametrize("name", [name for name in HOSTILE if name not in ("line end", "NUL")])
def test_hostile_texts_do_not_steer_the_terminal(tmp_path: Path, name: str) -> None:
    checked(tmp_path, 0, "fail", tip=HOSTILE[name] or "-")
    ran(tmp_path, 1, tips=[f"dde-1:1={HOSTILE[name]}"], order=HOSTILE[name], units=[HOSTILE[name]])
    ended = invoked("where-used", tmp_path, "--station", "dde-1")
    assert ended.exit_code == 0
    assert not MOVES.search(ended.stdout + ended.stderr)
