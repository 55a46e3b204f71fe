"""A station that tells states and no temperature: what it is judged by, and what a report shows of
it.
"""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from jbclog.core.rows import StationFacts
from jbclog.record.check import check
from jbclog.report.write import write_report
from support.records.sealed_run import samples, seal, station, table

STATES = ("solder_shortage", "preparing", "in_range")
RECIPE = '[recipe]\nname = "omega"\nrevision = 1\nfamilies = ["omega"]\n[acceptance]\n'
LIMITS = "coverage_percent = 99\nlongest_gap_s = 3\n"
Columns = dict[str, NDArray[np.generic]]


def rows_of_states(rows: int = 120) -> Columns:
    """A row each second: no solder from 60 to 70 s, preparing for 5 s, out of range in every
    fourth.
    """
    there = samples(rows, "omega-1", hz=1.0)
    for name in ("temperature_c", "power_permille", "setpoint_c", "alarm_high"):
        there[name] = np.full(rows, np.nan)
    there["status"] = np.full(rows, None, dtype=object)
    second = np.arange(rows)
    return there | {
        "solder_shortage": ((second >= 60) & (second < 70)).astype(float),
        "clogged": np.zeros(rows),
        "preparing": (second < 5).astype(float),
        "in_range": (second % 4 != 0).astype(float),
    }


def lose(columns: Columns, rows: slice, *names: str) -> None:
    for name in names:
        columns[name][rows] = np.nan
    signals = [name for name in names if name != "clogged"]
    columns["quality"][rows] = "timeout"
    columns["reasons"][rows] = ";".join(f"{name}=timeout" for name in signals)


def facts(rows: int = 120) -> StationFacts:
    found = station("omega-1", rows=rows, hz=1.0)
    found.family, found.model, found.software, found.address = "omega", None, None, None
    found.signals, found.tool_names, found.safe_state, found.touched, found.last_temperature_c = (
        list(STATES),
        {},
        {},
        [],
        {},
    )
    return found


def told(tmp_path: Path, columns: Columns, limits: str = LIMITS) -> dict[str, Any]:
    """What the report says of the run, as JSON; the record agrees with itself."""
    folder = seal(tmp_path, [facts()], table(columns), recipe=RECIPE + limits)
    write_report(folder)
    assert check(folder) == []
    found: dict[str, Any] = json.loads((folder / "report.json").read_text("utf-8"))
    return found


def rule(report: dict[str, Any], name: str) -> dict[str, Any]:
    (found,) = (one for one in report["verdict"]["rules"] if one["name"] == name)
    return dict(found)


def test_how_long_each_state_held_and_that_it_is_accepted(tmp_path: Path) -> None:
    report = told(tmp_path, rows_of_states())
    assert report["verdict"]["word"] == "ACCEPT"
    (port,) = report["stations"][0]["ports"]
    assert port["states"] == {
        "shortage_s": 10.0,
        "clogged_s": 0.0,
        "preparing_s": 5.0,
        "out_of_range_s": 30.0,
    }
    assert port["recorded"]["coverage_percent"] == 100
    assert (port["left"], port["left_warns"]) == ("has none", False)
    assert len(port["figures"]) == 1


def test_coverage_and_gap_are_those_of_its_states(tmp_path: Path) -> None:
    columns = rows_of_states()
    lose(columns, slice(10, 14), *STATES, "clogged")
    lose(columns, slice(30, 36), "in_range")
    report = told(tmp_path, columns)
    coverage, gap = rule(report, "coverage"), rule(report, "longest_gap")
    assert coverage["text"] == "State coverage 95 % (342 of 360), required 99 %."
    assert coverage["result"] == "fail"
    assert gap["text"] == "Longest gap in readings 5 s, allowed 3 s and a period of 1 s."
    (port,) = report["stations"][0]["ports"]
    (listed,) = port["recorded"]["gaps"]
    assert listed["seconds"] == pytest.approx(5, abs=0.05)  # when the answers came
    assert (listed["missing"], listed["reasons"]) == (4, "timeout")
    assert listed["at_least"] is False
    between = datetime.fromisoformat(listed["stop"]) - datetime.fromisoformat(listed["start"])
    assert between.total_seconds() == listed["seconds"]


def test_the_longest_gap_is_listed_first(tmp_path: Path) -> None:
    columns = rows_of_states()
    for lost in (slice(10, 11), slice(40, 44), slice(80, 82)):
        lose(columns, lost, *STATES, "clogged")
    (port,) = told(tmp_path, columns)["stations"][0]["ports"]
    assert [gap["missing"] for gap in port["recorded"]["gaps"]] == [4, 2, 1]


def test_limits_about_what_it_does_not_tell_are_not_about_it(tmp_path: Path) -> None:
    report = told(
        tmp_path, rows_of_states(), LIMITS + "idle_error_c = 15\nidle_sd_c = 5\nalarms_max = 0\n"
    )
    assert report["verdict"]["word"] == "ACCEPT"
    for name in ("idle_error", "idle_sd", "alarms"):
        assert rule(report, name)["result"] == "not applicable"
        assert rule(report, name)["observed"] is None
        assert rule(report, name)["text"].startswith("The station does not report ")


def test_a_recipe_none_of_whose_limits_is_about_it_is_no_plain_accept(tmp_path: Path) -> None:
    report = told(tmp_path, rows_of_states(), "idle_error_c = 15\n")
    assert report["verdict"]["word"] == "ACCEPT WITH DEVIATIONS"
    assert "None of its recipe's limits applies to it" in report["verdict"]["reasons"][0]["text"]


def test_nothing_read_at_all_is_never_accepted(tmp_path: Path) -> None:
    columns = rows_of_states()
    lose(columns, slice(0, 120), *STATES, "clogged")
    report = told(tmp_path, columns)
    assert report["verdict"]["word"] == "REJECT"
    assert rule(report, "longest_gap")["result"] == "missing"
    (port,) = report["stations"][0]["ports"]
    assert set(port["states"].values()) == {None}


def test_the_figure_has_a_lane_for_each_and_no_axis_of_temperature(tmp_path: Path) -> None:
    columns = rows_of_states()
    lose(columns, slice(100, 110), *STATES, "clogged")
    folder = seal(tmp_path, [facts()], table(columns), recipe=RECIPE + LIMITS)
    write_report(folder)
    drawn = (folder / "figures" / "omega-1-1.svg").read_text("utf-8")
    for word in (">solder<", ">control<", ">temperature<", ">no data<", ">shortage<", ">ready<"):
        assert word in drawn
    assert "Tip temperature" not in drawn
    assert "Power" not in drawn
