"""Coverage and the longest gap, counted from sealed samples whatever their order and parts."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.analysis.verdict import Rule, judge
from jbclog.analysis.verdict.samples import KeptMeasures, measure
from jbclog.config.recipe_sections import Acceptance


def gap(case: Any, port: int = 1) -> float | None:
    evidence = case.evidence()
    return measure(evidence.folder, {facts.name: facts for facts in evidence.stations})[
        "a", port
    ].gap_s


def test_no_gap_is_zero(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip())
    assert gap(case) == 0


@pytest.mark.parametrize(("start", "seconds"), [(0, 3), (20, 3.1), (57, 3)])
def test_a_gap_counts_at_the_beginning_in_the_middle_and_at_the_end(
    case: Any, tip: Callable[..., Any], start: float, seconds: float
) -> None:
    case.station("a", tip().lose(start, 3))
    assert gap(case) == seconds


def test_one_lost_reading_is_a_gap_of_two_periods(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip().lose(20, 0.1))
    assert gap(case) == 0.2


@pytest.mark.parametrize(
    ("most", "result"), [(2.9, "fail"), (3, "pass"), (3.05, "pass"), (0, "fail")]
)
@pytest.mark.parametrize("start", [0, 20, 57])
def test_a_gap_may_be_longer_than_its_limit_by_a_period(
    case: Any, tip: Callable[..., Any], start: float, most: float, result: str
) -> None:
    """Thirty readings are missing, and two of them are 3.1 s apart."""
    case.station("a", tip().lose(start, 3))
    judged = judge(case.evidence(), {"a": Acceptance(longest_gap_s=most)})
    (rule,) = [one for one in judged.rules if one.name == "longest_gap"]
    assert rule.result == result
    assert f"allowed {most:g} s and a period of 0.1 s." in rule.text


def test_a_limit_of_zero_is_kept_by_a_port_without_a_gap(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip())
    judged = judge(case.evidence(), {"a": Acceptance(longest_gap_s=0)})
    assert [one.result for one in judged.rules if one.name == "longest_gap"] == ["pass"]


def coverage_of(case: Any, percent: float) -> Rule:
    """The rule of coverage, with this limit."""
    return next(
        rule
        for rule in judge(case.evidence(), {"a": Acceptance(coverage_percent=percent)}).rules
        if rule.name == "coverage"
    )


def test_skipped_ticks_have_no_rows_and_count_in_both(case: Any, tip: Callable[..., Any]) -> None:
    facts = case.station("a", tip(), skipped=60)
    assert gap(case) == 6  # at the end: last_tick says that they were due
    assert facts.last_tick == 659
    coverage = coverage_of(case, 95)
    assert coverage.observed == pytest.approx(100 * 600 / 660)
    assert coverage.result == "missing"


def test_a_gap_between_two_parts_and_in_interleaved_rows(
    case: Any, tip: Callable[..., Any]
) -> None:
    facts = case.station("a", tip(), tip().lose(55, 5))
    case.seal([("a", 1, tip()), ("a", 2, tip().lose(0, 2))], first_tick=600)
    facts.last_tick = 1199
    assert gap(case, 1) == 0
    assert gap(case, 2) == 7.1


def test_small_row_groups_measure_the_same(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip(1300).lose(601, 4).at(30, 2, 320, 700), tip(1300).lose(3, 9))
    facts = {one.name: one for one in case.stations}
    whole = measure(case.folder, facts)
    path = case.folder / "samples" / "part-0000.parquet"
    pq.write_table(pq.read_table(path), path, row_group_size=97)
    pieces = measure(case.folder, facts)
    for port in (1, 2):
        assert pieces["a", port].gap_s == whole["a", port].gap_s
        assert pieces["a", port].idle == whole["a", port].idle
        assert pieces["a", port].readings == whole["a", port].readings


def test_without_a_grid_the_gap_is_taken_from_the_times(case: Any, tip: Callable[..., Any]) -> None:
    facts = case.station("a", tip().lose(20, 3))
    facts.period_s = facts.first_tick = facts.last_tick = None
    assert gap(case) == pytest.approx(3.1, abs=1e-6)


def test_a_port_without_any_temperature_has_no_gap(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip().lose(0, 60))
    assert gap(case) is None
    rules = {
        rule.name: rule
        for rule in judge(
            case.evidence(), {"a": Acceptance(longest_gap_s=5, coverage_percent=0)}
        ).rules
    }
    assert rules["longest_gap"].result == "missing"


@pytest.mark.parametrize(
    ("ok", "shown", "result"), [(24_874, "99.49 %", "fail"), (24_875, "99.5 %", "pass")]
)
def test_coverage_is_never_rounded_up_to_its_limit(
    case: Any, tip: Callable[..., Any], ok: int, shown: str, result: str
) -> None:
    case.station("a", tip(25_000, hz=1).lose(0, 25_000 - ok))
    coverage = coverage_of(case, 99.5)
    assert coverage.result == result
    assert shown in coverage.text


@pytest.mark.parametrize("rows_a_group", [16_384, 97])
@pytest.mark.parametrize("sizes", [(3600.0,), (-3600.0,), (3600.0, -7200.0), (-0.8, 30.0), (2.0,)])
def test_without_a_grid_a_stepped_clock_is_no_gap(
    case: Any,
    tip: Callable[..., Any],
    sizes: tuple[float, ...],
    rows_a_group: int,
) -> None:
    """Steps at 20 s and 40 s; at 30 s half a second is lost, which is a gap of 0.6 s between two
    readings.
    """
    facts = case.station("a", tip().lose(30, 0.5), tip().lose(30, 0.5))
    facts.period_s = None
    path = case.folder / "samples" / "part-0000.parquet"
    table = pq.read_table(path)
    times, sum_us = table["time"].cast("int64").to_numpy().copy(), 0
    zero = int(times[0])
    for second, size in zip((20, 40), sizes, strict=False):
        place = 2 * 10 * second  # two ports
        sum_us += round(size * 1e6)
        times[place:] += round(size * 1e6)
        told = zero + round((second + 0.03) * 1e6) + sum_us
        case.event("clock.step", "warning", time=told, value=size)
    place = table.schema.get_field_index("time")
    stepped = table.set_column(place, table.field(place), pa.array(times, table["time"].type))
    pq.write_table(stepped, path, row_group_size=rows_a_group)
    assert gap(case) == pytest.approx(0.6)
    assert gap(case, 2) == pytest.approx(0.6)


def test_stations_are_measured_once_for_the_same_limit(case: Any, tip: Callable[..., Any]) -> None:
    for name in ("a", "b"):
        case.station(name, tip(1300).lose(601, 4).at(30, 2, 320, 700))
    facts = {one.name: one for one in case.stations}
    whole, kept = measure(case.folder, facts), KeptMeasures()
    assert kept(case.folder, {"a": facts["a"]}, {}).keys() == {("a", 1)}
    assert kept(case.folder, facts, {}) == whole
    close = kept(case.folder, facts, {"b": 1.0})
    assert close["b", 1].heat.within_c == 1.0
    shutil.rmtree(case.folder / "samples")
    assert kept(case.folder, facts, {}) == whole
    assert kept(case.folder, facts, {"b": 1.0}) == close
