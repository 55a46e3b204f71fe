"""Any trouble in the field becomes a test: a run with its serial capture is replayed and gives the
same rows.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from support.product import ANOTHER_REQUEST, COLUMN, captured_rows, cut_capture, measure_less
from support.virtual.captured_run import RECIPE_FILE, recorded, relived
from support.virtual.virtual_run import RECIPE, Memory, line_text

FAULT = "[[station.sim.fault]]\nkind = "
TROUBLE = {
    "none": "",
    "corrupt frames": FAULT + '"flip"\nbits = 1\nat_s = 3\nfor_s = 4\nevery = 3',
    "frames that pass the check all the same": FAULT + '"flip"\nbits = 2\nat_s = 2\nevery = 7',
    "noise": FAULT + '"noise"\nat_s = 2\nfor_s = 5\nevery = 4',
    "time-outs": FAULT + '"silence"\nat_s = 4\nfor_s = 2\nevery = 6',
    "late answers": FAULT + '"late"\nby_s = 0.4\nat_s = 4\nfor_s = 3\nevery = 9',
    "an outage": FAULT + '"dropout"\nat_s = 6\nfor_s = 2.5',
    "two outages": (
        FAULT + '"dropout"\nat_s = 5\nfor_s = 0.7\n' + FAULT + '"dropout"\nat_s = 8\nfor_s = 1.2'
    ),
    "an outage to the end": FAULT + '"dropout"\nat_s = 6\nfor_s = 600',
    "Robot mode off for a while": FAULT + '"nak"\ncode = 5\nat_s = 5\nfor_s = 2',
    "a station that restarts": FAULT + '"restart"\nat_s = 6\nfor_s = 1.5',
    "an alarm": FAULT + '"overheat"\nat_s = 6\nfor_s = 3',
    "another tool": FAULT + '"tool"\ncode = 1\nat_s = 6\nfor_s = 2',
    "a recipe that is refused": FAULT + '"nak"\ncode = 3\nonly = "write"',
    "nobody there": FAULT + '"silence"',
    "all at once": "\n".join(
        FAULT + fault
        for fault in (
            '"flip"\nbits = 2\nevery = 11',
            '"noise"\nevery = 13',
            '"late"\nby_s = 0.3\nevery = 29',
            '"silence"\nat_s = 3\nevery = 31',
            '"dropout"\nat_s = 7\nfor_s = 1',
        )
    ),
}


def assert_same(first: Memory, again: Memory) -> None:
    """All rows are the same, with their times, and so are the facts of each station."""
    assert again.samples == first.samples
    assert again.events == first.events
    assert again.settings == first.settings
    assert again.counters == first.counters
    assert again.stations == first.stations


@pytest.mark.parametrize("trouble", TROUBLE)
def test_trouble_is_lived_through_again(tmp_path: Path, trouble: str) -> None:
    run = recorded(tmp_path / "run", line_text(TROUBLE[trouble]), duration_s=10)
    again, left = relived(tmp_path / "run")
    assert left == {}
    assert_same(run.memory, again)


@pytest.mark.parametrize("second", [0.01, 0.3, 1.2345, 6.06, 7.5])
def test_a_run_that_somebody_ended(tmp_path: Path, second: float) -> None:
    line = line_text(TROUBLE["an outage"])
    run = recorded(
        tmp_path / "run",
        line,
        duration_s=None,
        arrange=lambda run: run.at(second, lambda: run.driver.end("ended by SIGINT")),
    )
    again, left = relived(tmp_path / "run")
    assert left == {}
    assert_same(run.memory, again)
    assert any(
        "SIGINT" in row.text
        for row in captured_rows(tmp_path / "run", "dde-1")
        if row.what == "stopped"
    )


@pytest.mark.parametrize("rate", ["auto", "fit", "max", 3.0])
def test_every_rate(tmp_path: Path, rate: float | str) -> None:
    run = recorded(tmp_path / "run", line_text(TROUBLE["time-outs"]), duration_s=8, rate=rate)
    again, left = relived(tmp_path / "run")
    assert left == {}
    assert_same(run.memory, again)


def of_station(memory: Memory, name: str) -> Memory:
    samples = [row for row in memory.samples if row[COLUMN["station"]] == name]
    events, settings, counters = (
        [row for row in rows if row.station == name]
        for rows in (memory.events, memory.settings, memory.counters)
    )
    return Memory(samples, events, settings, counters, {name: memory.stations[name]})


def test_each_station_of_a_line(tmp_path: Path) -> None:
    """Actions of two stations at the same moment have no order."""
    second = line_text(TROUBLE["an outage"]).replace("dde-1", "dde-2").partition("[[station]]")[2]
    run = recorded(
        tmp_path / "run", line_text(TROUBLE["an outage"]) + "[[station]]" + second, duration_s=8
    )
    again, left = relived(tmp_path / "run")
    assert left == {}
    for name in ("dde-1", "dde-2"):
        assert_same(of_station(run.memory, name), of_station(again, name))


# -- a program that has changed since --------------------------------------------------------------


def test_a_program_that_asks_something_else_ends_where_it_leaves_its_tape(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It measured less, so its first event is earlier; behind the departure it records nothing."""
    run = recorded(tmp_path / "run", line_text(TROUBLE["corrupt frames"]), duration_s=10)
    measure_less(monkeypatch)
    again, left = relived(tmp_path / "run")
    assert ANOTHER_REQUEST in str(left["dde-1"])
    assert not left["dde-1"].is_cut_off
    kinds = [row.kind for row in again.events]
    assert kinds == ["station.ready"]
    assert kinds == [row.kind for row in run.memory.events][:1]
    assert again.samples == []


def test_another_recipe_ends_at_the_first_setting_that_was_not_recorded(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run", line_text(), duration_s=3)
    (tmp_path / "run" / "recipes" / RECIPE_FILE).write_text(
        RECIPE.replace("select_c = 350", "select_c = 330")
    )
    again, left = relived(tmp_path / "run")
    assert "WST1" in str(left["dde-1"])
    assert again.counters == run.memory.counters[: len(again.counters)]
    assert again.samples == []


# -- a recording without its end -------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_recording_that_was_cut_off_gives_what_had_been_recorded(
    tmp_path: Path, share: float
) -> None:
    run = recorded(tmp_path / "run", line_text(TROUBLE["an outage"]), duration_s=10)
    cut_capture(tmp_path / "run", "dde-1", share)
    again, left = relived(tmp_path / "run")
    assert left["dde-1"].is_cut_off
    assert again.samples == run.memory.samples[: len(again.samples)]
    assert again.settings == run.memory.settings[: len(again.settings)]
    assert again.events == run.memory.events[: len(again.events)]
    assert again.settings


def test_every_byte_is_kept_with_its_time(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run", line_text(TROUBLE["noise"]), duration_s=5)
    rows = captured_rows(tmp_path / "run", "dde-1")
    asked = [(row.at_s, row.data) for row in rows if row.what == "sent"]
    assert [at for at, _ in asked] == [one.at for one in run.heard]
    assert all(one.text.encode() in data for one, (_, data) in zip(run.heard, asked, strict=True))
    heard = b"".join(row.data for row in rows if row.what == "heard")
    struck = [one.sent for one in run.station.log.struck]
    assert struck
    assert all(sent in heard for sent in struck)
    assert [row.at_s for row in rows] == sorted(row.at_s for row in rows)
    assert len(run.memory.samples) == len(
        [row for row in run.memory.samples if row[COLUMN["station"]] == "dde-1"]
    )
