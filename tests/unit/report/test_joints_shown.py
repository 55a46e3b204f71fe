"""What a report says of joints: marked on the temperature, deficit and recovery as small multiples,
and a line that never rests.
"""

from __future__ import annotations

import csv
import html
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from jbclog.analysis.figures import style
from jbclog.analysis.figures.curves import Span
from jbclog.analysis.figures.port import draw
from jbclog.analysis.figures.style import WIDE
from jbclog.analysis.figures.trace import Grid, JointEnd, Trace
from jbclog.analysis.joints.series import Series
from jbclog.analysis.rejudge import judge_again
from jbclog.analysis.verdict.rules import JUDGED_BARE
from jbclog.record.manifest import read_manifest
from jbclog.report.joint_chart import draw_chart, recovery_chart
from jbclog.report.joint_words import never_back
from jbclog.report.joints import Joints, unit_rows
from jbclog.report.page import PASSES, when_passed
from jbclog.report.verdict import summary
from jbclog.report.write import write_report
from support.plants.scripted_tip import Contact, soldered
from support.readers.drawn import parts, seconds
from support.records.made_series import lose
from support.records.sealed_run import seal, station, table

HZ = 10.0
RECIPE = """[recipe]
name = "sn100c-tht"
revision = 7
families = ["dde"]

[acceptance]
idle_error_c = 15
recovery_p95_s = 3
recovered_before_next_percent = 95
"""
CALM = [(15.0 + 6 * number, 16.2 + 6 * number) for number in range(12)]
DENSE = [(30.0 + 1.8 * number, 30.8 + 1.8 * number) for number in range(40)]
WEAK = {"conductance": 0.8, "leak": 0.4, "rated_w": 50.0}
RATED_W = 130.0


def sealed(
    out: Path, series: Series, rated_w: float | None = RATED_W, recipe: str = RECIPE
) -> Path:
    """A sealed run of one port whose rows are these."""
    rows, count = series.rows, len(series.seconds)
    read = ~np.isnan(rows.temperature)
    facts = station(rows=count, hz=HZ)
    facts.rated_power_w = rated_w
    columns: dict[str, Any] = {
        "time": 1_790_000_000_000_000 + np.round(series.seconds * 1e6).astype(np.int64),
        "tick": np.arange(count),
        "station": np.full(count, "dde-1", dtype=object),
        "port": np.full(count, 1),
        "late_us": np.full(count, 100.0),
        "scan_us": np.full(count, 40_000.0),
        "quality": np.where(read, "ok", "timeout").astype(object),
        "reasons": np.where(read, None, "temperature_c=timeout").astype(object),
        "temperature_c": rows.temperature,
        "power_permille": rows.power,
        "status": np.full(count, "working", dtype=object),
        "setpoint_c": rows.setting,
    }
    return seal(out, [facts], table(columns), recipe=recipe)


def weak(contacts: list[Contact], seconds: float) -> Series:
    return soldered(contacts, seconds, **WEAK)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Told:
    """A report: its folder, its page, its data, and what they say of the only port."""

    folder: Path
    page: str
    data: dict[str, Any]

    @property
    def port(self) -> dict[str, Any]:
        return dict(self.data["stations"][0]["ports"][0])

    @property
    def in_csv(self) -> dict[str, str]:
        return next(
            iter(
                csv.DictReader(
                    (self.folder / "tables" / "ports.csv")
                    .read_text(encoding="utf-8-sig")
                    .splitlines()
                )
            )
        )


def told(folder: Path) -> Told:
    page = write_report(folder).read_text(encoding="utf-8")
    return Told(folder, page, json.loads((folder / "report.json").read_text()))


def both(folder: Path) -> tuple[str, dict[str, Any]]:
    """Page, and what the data say of the only port."""
    one = told(folder)
    return one.page, one.port


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Told:
    return told(sealed(tmp_path_factory.mktemp("calm"), soldered(CALM, 90.0)))


@pytest.fixture(scope="module")
def dense(tmp_path_factory: pytest.TempPathFactory) -> Told:
    return told(sealed(tmp_path_factory.mktemp("dense"), weak(DENSE, 104.0)))


def test_a_line_that_never_lets_its_tip_recover_is_named_in_the_verdict_on_page_and_paper(
    dense: Told,
) -> None:
    page = dense.page
    data = dense.data
    port = dense.port
    (sentence,) = [one["text"] for one in data["verdict"]["reasons"] if one["result"] == "none"]
    assert sentence.startswith("dde-1 port 1: This line ")
    assert "lets the tip recover: after " in sentence
    assert "°C below the setpoint (median)" in sentence
    assert sentence.replace(" °C", "\u00a0°C") in page
    assert port["joints"]["never_back"] == sentence.removeprefix("dde-1 port 1: ")
    share = port["joints"]["figures"]["recovered_before_next_percent"]["value"]
    assert share < 50
    assert data["verdict"]["word"] != "ACCEPT"
    assert not [
        rule
        for rule in judge_again(dense.folder, read_manifest(dense.folder)).rules
        if rule.name.startswith("recover") and rule.result == "pass"
    ]


def test_a_line_that_rests_is_not_named(calm: Told) -> None:
    page = calm.page
    port = calm.port
    assert port["joints"]["never_back"] is None
    assert "This line" not in page
    assert port["joints"]["figures"]["recovered_before_next_percent"]["value"] == 100


@pytest.mark.parametrize(
    ("late", "joints", "how"),
    [
        (4, 4, None),
        (20, 100, None),
        (60, 100, "seldom"),
        (97, 100, "hardly ever"),
        (98, 98, "never"),
    ],
)
def test_how_seldom_a_tip_recovers_in_words(late: int, joints: int, how: str | None) -> None:
    text = never_back(late, joints, 36.5)
    assert (text is None) == (how is None)
    if how is not None:
        assert text is not None
        assert f"This line {how} lets the tip recover: after {late} of {joints} joints" in text


def test_every_joint_is_marked_on_the_temperature_figure(calm: Told) -> None:
    assert calm.port["joints"]["found"] == len(CALM)
    assert f"Bars at the foot: {len(CALM)} joints." in calm.port["figures"][0]["caption"]
    assert calm.port["figures"][0]["alt"].count(f"{len(CALM)} joints") == 1


def test_joints_without_recovery_are_marked_apart(dense: Told) -> None:
    late = dense.port["joints"]["figures"]["joints_not_recovered"]["value"]
    assert (
        f"high and red: {late:.0f} after which the next one came"
        in dense.port["figures"][0]["caption"]
    )


def test_the_marks_lie_where_the_joints_are() -> None:
    ticks = np.arange(600) / HZ
    joints = [
        Span(10.0, 11.0, JointEnd.BACK),
        Span(20.0, 22.0, JointEnd.LATE),
        Span(30.0, 31.0, JointEnd.CUT_OFF),
    ]
    level = np.full(600, 350.0)
    one = Trace(
        Grid(0, 1 / HZ),
        1 / HZ,
        ticks,
        level,
        level,
        level,
        [Span(0.0, 60.0, "working")],
        [],
        joints=joints,
    )
    drawing = draw(one, WIDE)
    for joint in joints:
        (bar,) = parts(drawing, f"joint {joint.word}")
        assert sorted({*seconds(0, bar[:, 0]).round(3)}) == pytest.approx([joint.start, joint.end])
        assert bar[:, 1].min() == 0  # at the foot
    heights = {word: style.JOINT_HEIGHTS[word] for word in (JointEnd.BACK, JointEnd.LATE)}
    assert heights[JointEnd.LATE] > heights[JointEnd.BACK]  # also on a grey printer
    assert one.between(15.0, 25.0).joints == [joints[1]]


def test_deficit_and_recovery_stand_one_below_the_other_and_a_joint_that_was_followed_has_an_arrow(
    dense: Told,
) -> None:
    port = dense.port
    chart = (dense.folder / port["joints"]["chart"]["file"]).read_text()
    assert "Below the setpoint at the start in °C" in chart
    assert "Recovery in s" in chart
    deficits, had = np.full(8, 20.0), np.where(np.arange(8) < 6, 1.8, np.nan)
    drawing = draw_chart(
        recovery_chart(np.where(np.isnan(had), 1.2, np.nan), 0.1, deficits, had), WIDE
    )
    assert len(parts(drawing, "late")) == 6 + 6  # a stem and a head each
    assert len(parts(drawing, "deficit")) == 8


def test_no_limits_where_too_many_joints_have_no_recovery() -> None:
    recovery = np.random.default_rng(3).normal(1.6, 0.1, 60)
    had = np.full(60, np.nan)
    assert recovery_chart(recovery, 0.01, None, had).signals is not None
    recovery[:6], had[:6] = np.nan, 1.8
    chart = recovery_chart(recovery, 0.01, None, had)
    assert chart.signals is None
    assert "After 6 of 60 joints the next one came before the tip was back" in chart.caption


def test_idle_error_stands_beside_recovery_and_what_was_found_with_is_said(calm: Told) -> None:
    page = calm.page
    port = calm.port
    assert "A joint lasts 0.25\u00a0s or more" in page
    assert (
        "Learned from the run, as the recipe's [joints] does not set them: least_dwell_s,"
        " merge_gap_s, wire_decides." in page.replace("&#39;", "'")
    )
    head = page[page.index("Back before next") : page.index("Heat</tr>")]
    assert head.index("95&nbsp;% recovery") < head.index("Idle error") < head.index("Depth")
    assert port["joints"]["taken"]["learnt"] == ["least_dwell_s", "merge_gap_s", "wire_decides"]


def test_the_regular_time_between_joints_is_learnt_and_shown(calm: Told, tmp_path: Path) -> None:
    said = "Time between joint starts, learned from the run (the recipe sets no expected_every_s)"
    assert calm.port["joints"]["taken"]["every_s"] == pytest.approx(6.0, abs=0.05)
    assert f"{said}: 6 s. Not used to find joints." in calm.page.replace("\u00a0", " ")
    uneven = [
        (15.0 + 2 * number + 0.3 * number**2, 15.9 + 2 * number + 0.3 * number**2)
        for number in range(12)
    ]
    page, port = both(sealed(tmp_path, soldered(uneven, 90.0)))
    assert port["joints"]["taken"]["every_s"] is None
    assert f"{said}: not regular or too few." in page


def test_what_the_recipe_says_of_joints_is_not_learnt(tmp_path: Path) -> None:
    page, port = both(
        sealed(
            tmp_path,
            soldered(CALM, 90.0),
            recipe=f"{RECIPE}\n[joints]\nleast_dwell_s = 0.6\nrecovered_within_c = 5\n",
        )
    )
    assert port["joints"]["taken"]["learnt"] == ["merge_gap_s", "wire_decides"]
    assert "A joint lasts 0.6\u00a0s or more" in page
    assert "the tip is back within 5\u00a0°C" in page


def test_joints_that_are_not_known_are_named_with_the_reason(tmp_path: Path) -> None:
    series = lose(soldered(CALM, 90.0), *((start + 0.3, start + 3.3) for start, _ in CALM))
    page, port = both(sealed(tmp_path, series))
    assert port["joints"]["figures"]["joints"]["value"] is None
    assert "not known: " in page[page.index("<h2>Joints") :]
    assert "No joints were found." not in page


def test_one_joint_before_a_record_full_of_gaps_proves_nothing(tmp_path: Path) -> None:
    """Gaps of 3 s in every joint but the first: the share that recovered is not 1 of 1."""
    series = lose(soldered(CALM, 90.0), *((start - 0.5, start + 2.5) for start, _ in CALM[1:]))
    folder = sealed(tmp_path, series)
    rules = {rule.name: rule for rule in judge_again(folder, read_manifest(folder)).rules}
    share, recovery = rules["recovered_before_next"], rules["recovery_p95"]
    assert (share.observed, share.result, recovery.result) == (100, "missing", "missing")
    assert "s of work that was not read are not known." in share.text


def test_there_is_one_energy(calm: Told) -> None:
    """Of metrics, ports.csv, report.json and page; the trapezoid of the power."""
    page = calm.page
    port = calm.port
    whole, joules = (
        next(one for one in calm.data["metrics"] if one["metric"] == name)["value"]
        for name in ("energy_permille_s", "energy_j")
    )
    row = calm.in_csv
    power = soldered(CALM, 90.0).rows.power
    assert whole == pytest.approx(float(np.trapezoid(power, dx=1 / HZ)))
    assert float(row["energy_permille_s"]) == port["power"]["energy_permille_s"] == whole
    assert (
        float(row["energy_j"])
        == port["power"]["energy_j"]
        == joules
        == pytest.approx(whole * RATED_W / 1000)
    )
    assert float(row["energy_wh"]) == pytest.approx(joules / 3600)
    assert f"{joules:,.0f} J".replace(",", "\u202f") in page


def test_an_energy_with_a_gap_is_not_known_anywhere(tmp_path: Path) -> None:
    one = told(sealed(tmp_path, lose(soldered(CALM, 90.0), (40.0, 43.0))))
    page, port, row = one.page, one.port, one.in_csv
    assert row["energy_permille_s"] == row["energy_wh"] == row["energy_j"] == ""
    assert port["power"]["energy_permille_s"] is None
    assert port["power"]["energy_recorded_permille_s"] > 0
    assert "no reading" in port["power"]["energy_why"]
    assert "<dd>not known: gaps</dd>" in page


def test_a_unit_with_joints_without_recovery_has_no_slowest_and_no_flattering_median() -> None:
    rows = [
        (1.2, 1.2, True),
        (1.4, 1.4, True),
        (None, 1.8, False),
        (None, 1.8, False),
        (None, None, None),
    ]
    columns = {
        name: [row[number] for row in rows]
        for number, name in enumerate(("recovery_s", "had_s", "recovered"))
    }
    table = pa.table({"unit": ["SN-1"] * 5, **columns})
    found = Joints(table, {}, [], [], {})
    (unit,) = unit_rows(found)
    assert (unit["joints_found"], unit["recovery_n"], unit["not_recovered"]) == (5, 2, 2)
    assert (unit["recovery_p50_s"], unit["recovery_slowest_s"]) == (1.4, None)
    (quick,) = unit_rows(Joints(table[:2], {}, [], [], {}))
    assert (quick["not_recovered"], quick["recovery_slowest_s"]) == (0, 1.4)


def test_page_and_paper_say_in_the_verdict_that_bare_figures_were_judged(tmp_path: Path) -> None:
    one = told(
        sealed(
            tmp_path,
            soldered(CALM, 90.0),
            recipe=RECIPE.replace("idle_error_c", 'confidence = "none"\nidle_error_c'),
        )
    )
    assert one.data["verdict"]["reasons"][0]["text"] == f"dde-1: {JUDGED_BARE}"
    assert JUDGED_BARE in html.unescape(one.page[: one.page.index("What the verdict rests on")])
    assert "Except on dde-1: its recipe judges figures without bounds." in one.page
    assert when_passed([]) == PASSES


def test_the_worst_share_of_recovered_joints_is_the_least() -> None:
    def rule(port: int, observed: float, name: str = "recovered_before_next") -> dict[str, object]:
        return {
            "name": name,
            "station": "a",
            "port": port,
            "limit_value": 95.0,
            "observed": observed,
            "uom": "%",
            "result": "fail",
            "bound": None,
        }

    lines = summary(
        [
            *(rule(port, 40.0 + port) for port in range(1, 8)),
            *(rule(port, 1.0, "other") for port in range(6)),
        ]
    )
    assert (lines[0]["worst"], lines[0]["port"]) == (41.0, 1)
