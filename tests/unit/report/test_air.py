"""What a report says and shows of hot air: the air, the work below it, the flow, cooling and
suction.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from jbclog.analysis.figures.from_samples import trace
from jbclog.analysis.figures.lanes import lanes_of
from jbclog.analysis.figures.port import draw
from jbclog.analysis.figures.style import WIDE
from jbclog.analysis.figures.trace import Grid, Trace
from jbclog.analysis.verdict import Evidence, judge
from jbclog.config.recipe_sections import Acceptance
from jbclog.core.rows import StationFacts
from jbclog.protocol.commands.family import FAMILIES
from jbclog.record.ledger import ledger_of
from jbclog.report.write import write_report
from support.readers.drawn import artists, corners, panel, texts
from support.records.sealed_run import RECIPE, lose, micros, samples, seal, station, table

HEAD = [
    ("Setpoint", "320 °C"),
    ("Air min–max", "320 to 320 °C"),
    ("Idle error ± sd", "0.0 ± 0.0 °C"),
]


def jtse(rows: int) -> StationFacts:
    facts = station("jtse-1", rows=rows)
    facts.family, facts.model, facts.tool_names = "jtse", "JTSE", {1: "JT"}
    facts.signals = [signal.name for signal in FAMILIES["jtse"].signals]
    return facts


def columns(rows: int = 600) -> dict[str, NDArray[np.generic]]:
    """A minute at 320 °C: two parts are lifted off, and at the end it cools."""
    made, second = samples(rows, "jtse-1"), np.arange(rows) / 10
    made["alarm_high"] = np.full(rows, np.nan)
    cooling = second >= 50
    status = np.where(cooling, "off", "on").astype(object)
    due = np.arange(rows) % 50 == 0
    return made | {
        "temperature_c": np.full(rows, 320.0),
        "power_permille": np.full(rows, 210.0),
        "setpoint_c": np.where(due, 320.0, np.nan),
        "status": status,
        "cooling": cooling.astype(np.float64),
        "desoldering": ((second % 20 > 18) & ~cooling).astype(np.float64),
        "external_c": np.round(60 + 100 * np.abs(np.sin(second / 20 * np.pi))),
        "set_flow_permille": np.where(due, np.where(second < 30, 600.0, 400.0), np.nan),
    }


def drawn(made: dict[str, NDArray[np.generic]]) -> Trace:
    return trace(table(made).to_pandas(), Grid(micros(0), 0.1), of_air=True)


def test_cooling_is_a_status_of_its_own_and_flow_and_suction_have_lanes() -> None:
    one = drawn(columns())
    lanes = {
        lane.name: [(span.word, round(span.start, 1), round(span.end, 1)) for span in lane.spans]
        for lane in lanes_of(one, WIDE)
    }
    assert lanes["status"] == [("on", 0.0, 50.0), ("cooling", 50.0, 60.0)]
    assert lanes["flow"] == [
        ("600 ‰", 0.0, 25.1),
        ("400 ‰", 30.0, 55.1),
    ], "between two that differ nothing is known"
    sucked = [(18.1, 20.0), (38.1, 40.0)]
    assert [span[1:] for span in lanes["suction"]] == [
        *sucked,
        *sucked,
    ], "and over them, wide enough to be seen in a long run"


def test_the_work_is_drawn_and_named_beside_the_air() -> None:
    one = drawn(columns())
    drawing = draw(one, WIDE)
    assert {"Air temperature in °C, and that of the work", "set 320", "work"} <= {*texts(drawing)}
    assert corners(drawing, "external")[:, 1].max() == pytest.approx(160)
    low, high = panel(drawing, 0).get_ylim()
    assert low < 60
    assert high > 320


def test_without_a_thermocouple_nothing_is_drawn_of_the_work() -> None:
    drawing = draw(drawn(columns() | {"external_c": np.full(600, np.nan)}), WIDE)
    assert {"Air temperature in °C", "set 320"} <= {*texts(drawing)}
    assert "work" not in texts(drawing)
    assert not artists(drawing, "external")


def test_a_closer_look_holds_the_same_of_its_part() -> None:
    part = drawn(columns()).between(10, 25)
    assert part.air is not None
    assert len(part.air.external) == len(part.seconds) == 151
    assert [(span.start, span.end) for span in part.air.lanes["suction"]] == [
        pytest.approx((18.1, 20.0))
    ]


def flows(one: Trace) -> list[tuple[str, float, float]]:
    assert one.air is not None
    return [(span.word, round(span.start, 1), round(span.end, 1)) for span in one.air.lanes["flow"]]


def test_the_flow_is_not_joined_across_an_outage() -> None:
    made = columns()
    lose(made, slice(110, 140))
    assert flows(drawn(made))[:2] == [("600 ‰", 0.0, 10.1), ("600 ‰", 15.0, 25.1)]


def test_nobody_cools_while_nothing_is_read() -> None:
    made = columns()
    lose(made, slice(520, 540))
    made["cooling"][520:540] = np.nan
    one = drawn(made)
    assert [(span.word, span.start) for span in one.status] == [
        ("on", 0.0),
        ("cooling", 50.0),
        ("cooling", 54.0),
    ]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return seal(tmp_path, [jtse(600)], table(columns()), recipe=RECIPE.replace("dde", "jtse"))


def test_the_page_speaks_of_air_and_not_of_tips_and_alarms(folder: Path) -> None:
    html = write_report(folder).read_text("utf-8")
    for words in ("Air min–max", "Work min–max", "60 to 160 °C", "400 ‰", "2 times"):
        assert words in html
    assert "<dt>Alarms" not in html
    assert "Tip min–max" not in html
    assert "Air temperature coverage 100\N{NO-BREAK SPACE}% (600 of 600)" in html
    assert "The station does not report alarm flags; the limit does not apply." in html


def test_its_twin_holds_the_figures(folder: Path) -> None:
    write_report(folder)
    port = json.loads((folder / "report.json").read_text("utf-8"))["stations"][0]["ports"][0]
    assert port["air"] == {
        "flow_permille": 400.0,
        "external_least_c": 60.0,
        "external_greatest_c": 160.0,
        "suctions": 2,
    }
    assert port["tip"]["greatest_c"] == 320.0
    assert port["states"] is None
    assert port["figures"][0]["alt"].startswith(
        "jtse-1, port 1: air temperature from 320 to 320 °C over 1 min"
    )


def test_without_a_thermocouple_the_page_says_so(tmp_path: Path) -> None:
    made = columns() | {"external_c": np.full(600, np.nan)}
    html = write_report(seal(tmp_path, [jtse(600)], table(made))).read_text("utf-8")
    assert "no thermocouple" in html


def test_hot_air_is_judged_by_what_it_tells(tmp_path: Path) -> None:
    """It has no alarm flags: that is no missing evidence."""
    limits = Acceptance(
        coverage_percent=99.5, longest_gap_s=5, idle_error_c=15, idle_sd_c=5, alarms_max=0
    )
    facts = [jtse(3200)]
    working = {"status": np.full(3200, "on", dtype=object), "cooling": np.zeros(3200)}
    folder = seal(tmp_path, facts, table(columns(3200) | working))
    judgement = judge(Evidence(folder, facts, ledger_of(folder, facts)), {"jtse-1": limits})
    assert judgement.verdict == "ACCEPT"
    results = {one.name: one.result.value for one in judgement.rules}
    assert results["alarms"] == "not applicable"
    assert results["idle_error"] == results["idle_sd"] == "pass"
