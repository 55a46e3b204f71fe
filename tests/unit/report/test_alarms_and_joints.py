"""What a report says of alarms, of joints and of tip verifications: the same as their own commands,
and what was said since.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jbclog.analysis.figures.style import NARROW, WIDE
from jbclog.analysis.run import open_run
from jbclog.analysis.run_alarms import ACKNOWLEDGED
from jbclog.core.rows import EventRow, Severity, TipCheck
from jbclog.record.annotations import append
from jbclog.record.check import check
from jbclog.record.manifest import Metadata, read_manifest, write_manifest
from jbclog.report.joint_chart import draw_chart, recovery_chart
from jbclog.report.paper_tables import merge_repeated
from jbclog.report.safety import short, verification_facts
from jbclog.report.write import write_report
from support.readers.drawn import boxes, parts, texts
from support.readers.run_files import differing_files
from support.records.sealed_run import alarm, limit, lose, micros, samples, seal, station, table

LIMITS = [limit("high", "380"), limit("low", "300")]


def hot(tmp_path: Path, **manifest: object) -> Path:
    """A run of two minutes whose tip is beyond its limit for three seconds; the station says so
    too.
    """
    columns = samples(1200)
    columns["temperature_c"][600:630] = 395
    columns["alarm_high"][620] = 1.0
    return seal(tmp_path, [station(rows=1200)], table(columns), [alarm(62)], LIMITS, **manifest)  # type: ignore[arg-type]


def told(folder: Path) -> tuple[str, dict[str, Any]]:
    html = write_report(folder).read_text("utf-8")
    return html, json.loads((folder / "report.json").read_text("utf-8"))


def rows(folder: Path, name: str) -> list[dict[str, str]]:
    return [
        *csv.DictReader(io.StringIO((folder / "tables" / f"{name}.csv").read_text("utf-8-sig")))
    ]


def test_alarms_are_those_of_their_command_with_what_was_acknowledged_since(tmp_path: Path) -> None:
    folder = hot(tmp_path)
    html, facts = told(folder)
    found = open_run(folder).alarm_findings()
    (incident,) = [one for one in facts["alarms"]["incidents"] if one["is_alarm"]]
    assert [row["episode"] for one in facts["alarms"]["incidents"] for row in one["episodes"]] == [
        row["episode"] for row in found.rows()
    ]
    assert (facts["alarms"]["waiting"], incident["waiting"], incident["side"]) == (1, True, "high")
    assert incident["start_earliest"] < incident["start"]
    assert facts["alarms"]["findings"] == found.findings()
    assert "not acknowledged" in html
    assert [row["episode"] for row in rows(folder, "alarms")] == [
        row["episode"] for row in found.rows()
    ]

    append(
        folder,
        who="A. Rossi",
        what=incident["name"],
        why="door open",
        kind=ACKNOWLEDGED,
        utc_s=1_790_000_900.0,
    )
    assert "report.html" in differing_files(folder), (
        "a report from before it was said is not this one"
    )
    html, facts = told(folder)
    assert differing_files(folder) == []
    assert facts["alarms"]["waiting"] == 0
    assert "A. Rossi, 2026-09-21 14:28:20: door open" in html
    assert f"hash <code>{facts['annotations_head'][:24]}</code>" in html
    assert facts["annotations_head"] in html.split("<footer>")[1]
    assert "not acknowledged" not in html


def test_acknowledgements_that_were_changed_are_named_on_the_page_and_by_check(
    tmp_path: Path,
) -> None:
    folder = hot(tmp_path)
    name = open_run(folder).alarm_findings().incidents[0].name
    append(
        folder, who="A. Rossi", what=name, why="door open", kind=ACKNOWLEDGED, utc_s=1_790_000_900.0
    )
    said = folder / "annotations.jsonl"
    said.write_text(said.read_text("utf-8").replace("A. Rossi", "B. Rossi"), "utf-8")
    html, facts = told(folder)
    wrong = "annotations.jsonl: line 1 is no annotation, or was changed"
    assert facts["annotations_wrong"] == [wrong]
    assert facts["alarms"]["waiting"] == 1
    assert html.count(f"{wrong}. Annotations from there on are not verified.") == 1
    assert wrong in map(str, check(folder))


def test_joints_are_listed_by_port_and_by_unit_with_their_chart(tmp_path: Path) -> None:
    begins = [
        EventRow(micros(s), "unit.begin", Severity.INFO, "", raw=f"SN-{n}")
        for n, s in enumerate((0, 40, 80), 1)
    ]
    folder = seal(tmp_path, [station(rows=1200)], table(samples(1200)), begins, LIMITS)
    html, facts = told(folder)
    run = open_run(folder)
    joints, metrics = run.joints(), run.metrics().set_index("metric")
    mine = facts["stations"][0]["ports"][0]["joints"]
    assert mine["found"] == len(joints) > 20
    for name in ("recovery_s", "recovery_p95_s", "joint_depth_c", "joint_dwell_s"):
        assert mine["figures"][name]["value"] == metrics.loc[name, "value"], name
        assert mine["figures"][name]["n"] == metrics.loc[name, "n"], name
    listed = rows(folder, "joints")
    assert [int(row["joint"]) for row in listed] == joints["joint"].tolist()
    assert [row["unit"] for row in listed] == run.unit_at(joints["start"]).tolist()
    assert [(one["unit"], one["joints_found"]) for one in facts["units"]] == [
        (unit, sum(row["unit"] == unit for row in listed)) for unit in ("SN-1", "SN-2", "SN-3")
    ]
    assert (folder / mine["chart"]["file"]).is_file()
    assert "SN-2" in html
    assert len(rows(folder, "metrics")) == len(facts["metrics"]) == len(run.metrics())


def test_a_run_without_units_lists_none_and_a_late_unit_is_listed(tmp_path: Path) -> None:
    folder = seal(tmp_path, [station(rows=600)], table(samples(600)), metadata=Metadata())
    assert told(folder)[1]["units"] == []
    append(
        folder,
        who="M. Weber",
        what="SN-9",
        why="read later",
        kind="unit.late",
        utc_s=1_790_000_900.0,
    )
    assert [one["unit"] for one in told(folder)[1]["units"]] == ["SN-9"]


def test_joints_in_gaps_are_not_known(tmp_path: Path) -> None:
    columns = samples(1200)
    lose(columns, slice(300, 400))
    html, facts = told(seal(tmp_path, [station(rows=1200)], table(columns), (), LIMITS))
    count = facts["stations"][0]["ports"][0]["joints"]["figures"]["joints"]
    assert count["value"] is None
    assert count["n"] == facts["stations"][0]["ports"][0]["joints"]["found"]
    assert "Joints in gaps are not known." in html


CHECK = TipCheck(
    "dde-1",
    1,
    "pass",
    "text",
    "2026-09-10T08:00:00.000000Z",
    11.0,
    "TIP-0231",
    "TC-7",
    -4.2,
    15.0,
    0.0,
    3,
    "ab" * 32,
)
FAILED = TipCheck(
    "dde-1",
    1,
    "fail",
    "23 °C too cold.",
    "2026-09-21T12:00:00.000000Z",
    0.1,
    "TIP-0231",
    "TC-7",
    -23.0,
    15.0,
)
NONE = TipCheck("dde-1", 1, "none", "No valid verification of its tip is known.")


@pytest.mark.parametrize(
    ("check", "observed", "state", "words"),
    [
        (
            CHECK,
            11.0,
            "pass, 11.0 d",
            (
                "Verified 11.0 d before the run with TC-7, tip TIP-0231, -4.2 °C from the station's"
                " own reading"
            ),
        ),
        (CHECK, "expired", "expired, 11.0 d", "what the rule says"),
        (FAILED, None, "fail, 2.4 h", "23 °C too cold."),
        (NONE, None, "none", "No valid verification of its tip is known."),
        (None, None, "none", "This record cites no verification of its tip."),
    ],
)
def test_a_port_names_the_verification_that_it_stood_on(
    check: TipCheck | None, observed: float | str | None, state: str, words: str
) -> None:
    rule = {
        "name": "verification",
        "station": "dde-1",
        "port": 1,
        "observed": observed,
        "text": "what the rule says",
    }
    facts = verification_facts(check, [rule] if observed is not None else [], "dde-1", 1)
    assert short(facts) == state
    assert words in str(facts["text"])


def test_the_page_has_a_line_for_it(tmp_path: Path) -> None:
    folder = seal(tmp_path, [station(rows=300)], table(samples(300)))
    manifest = read_manifest(folder)
    manifest.verifications = [CHECK]
    write_manifest(folder, manifest)
    html, facts = told(folder)
    assert "Tip verification: pass." in html
    assert facts["stations"][0]["ports"][0]["verification"]["instrument"] == "TC-7"


def course(count: int, seed: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).normal(1.6, 0.1, count)


@pytest.mark.parametrize("form", [WIDE, NARROW])
@pytest.mark.parametrize("count", [5, 40, 5000])
def test_the_chart_of_the_recovery_has_its_labels_apart_and_inside(form: Any, count: int) -> None:
    drawing = draw_chart(recovery_chart(course(count), 0.01), form)
    placed = boxes(drawing)
    assert all(box.left >= 0 and box.right <= form.width_pt and box.bottom >= 0 for box in placed)
    for number, one in enumerate(placed):
        for other in placed[:number]:
            across, down = (
                min(one.right, other.right) - max(one.left, other.left),
                min(one.top, other.top) - max(one.bottom, other.bottom),
            )
            assert min(across, down) < 0.5, (one.text, other.text)
    assert len(parts(drawing, "recovery")) >= 1


def test_a_point_out_of_the_ordinary_is_marked_and_counted() -> None:
    recovery = course(60)
    recovery[30] = 2.6
    chart = recovery_chart(recovery, 0.01)
    assert chart.signals is not None
    assert 30 in chart.signalling
    assert len(parts(draw_chart(chart, WIDE), "signal")) >= chart.signals
    assert "out of the ordinary (" in chart.caption


CASES: list[tuple[Callable[[], np.ndarray], float, str]] = [
    (lambda: course(12), 0.01, "takes at least 20"),
    (lambda: course(60).round(1), 0.4, "that of the resolution"),
    (lambda: course(60).cumsum(), 0.01, "Neighbouring values are alike"),
]


@pytest.mark.parametrize(("recovery", "resolution", "why"), CASES)
def test_what_would_mislead_has_no_limits_and_says_why(
    recovery: Callable[[], np.ndarray], resolution: float, why: str
) -> None:
    chart = recovery_chart(recovery(), resolution)
    assert chart.signals is None
    assert why in chart.caption
    assert not any(word.startswith("limit") for word in texts(draw_chart(chart, WIDE)))


def test_repeated_warnings_are_one_row_on_paper_and_grave_events_a_row_each() -> None:
    def event(n: int, severity: str, text: str = "lost") -> dict[str, object]:
        return {
            "station": "a",
            "port": 1,
            "kind": "k",
            "severity": severity,
            "text": text,
            "time": n,
        }

    merged = merge_repeated(
        [
            event(1, "warning"),
            event(2, "critical"),
            event(3, "warning"),
            event(4, "warning"),
            event(5, "critical"),
        ]
    )
    assert [(one["time"], one.get("times"), one.get("until")) for one in merged] == [
        (1, 3, 4),
        (2, None, None),
        (5, None, None),
    ]
    assert len(merge_repeated([event(1, "warning"), event(2, "warning")])) == 2
