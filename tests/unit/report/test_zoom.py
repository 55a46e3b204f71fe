"""The data of the interactive view: the record's readings to the number, and where they are too
many, no excursion lost.
"""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.analysis.figures.curves import Span
from jbclog.analysis.figures.from_samples import trace
from jbclog.analysis.figures.trace import Grid, JointEnd, Mark, MarkKind, Trace
from jbclog.report import zoom
from jbclog.report.write import write_report
from jbclog.report.zoom import (
    BOUND,
    LEAST_SPANS,
    LONGEST_WORD,
    MOST_READINGS,
    share,
    varints,
    zoom_of,
)
from support.readers.texts import ROOT
from support.readers.zoom_data import Numbers, ZoomData, zoom_data
from support.records.sealed_run import alarm, limit, lose, samples, seal, station, table

UPLOT = files("jbclog.report").joinpath("vendor", "uplot")
VALUES = {"temperature_c": "temperature_c", "power_permille": "power_permille"}


def traced(rows: int) -> Trace:
    second = np.arange(rows) / 10
    columns = {
        "time": pd.to_datetime((1_790_000_000 + second) * 1e6, unit="us", utc=True),
        "tick": np.arange(rows),
        "temperature_c": 350.0 + np.arange(rows) % 3,
        "power_permille": np.full(rows, 80.0),
        "setpoint_c": np.where(np.arange(rows) % 50 == 0, 350.0, np.nan),
        "status": "working",
        "quality": "ok",
    }
    drawn = trace(pd.DataFrame(columns), Grid(1_790_000_000_000_000, 0.1))
    return replace(drawn, temperature=drawn.temperature.copy())


def data(drawn: Trace, most: int = MOST_READINGS) -> ZoomData:
    found = zoom_of(drawn, most)
    assert found is not None
    return zoom_data(found)


def recorded(tmp_path: Path, rows: int = 2400) -> tuple[Path, pd.DataFrame]:
    """A run with an outage, a lost power reading, ticks without rows and an alarm, and its rows as
    they are in the Parquet.
    """
    columns = samples(rows)
    lose(columns, slice(1000, 1030))
    columns["power_permille"][500] = np.nan
    columns["reasons"][500] = "power_permille=timeout"
    columns["temperature_c"][700:705] = 392
    skipped = (np.arange(rows) < 1500) | (np.arange(rows) >= 1520)
    columns = {name: values[skipped] for name, values in columns.items()}
    folder = seal(
        tmp_path,
        [station(rows=rows)],
        table(columns),
        [alarm(72)],
        [limit("high", "380"), limit("low", "300")],
    )
    return folder, pd.concat(
        pd.read_parquet(part) for part in sorted((folder / "samples").glob("*.parquet"))
    )


Shown = tuple[str, pd.DataFrame]
"""The page of a run, and its rows."""


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    folder, rows = recorded(tmp_path_factory.mktemp("run"))
    return write_report(folder).read_text("utf-8"), rows


def embedded(page: str) -> ZoomData:
    found = re.findall(r'data-zoom="([^"]*)"', page)
    assert len(found) == 1
    return zoom_data(found[0])


def same(found: np.ndarray[tuple[int], np.dtype[np.float64]], wanted: pd.Series[float]) -> bool:
    return np.array_equal(found, wanted.to_numpy(dtype=np.float64, na_value=np.nan), equal_nan=True)


def test_the_page_holds_every_reading_of_the_record_and_why_there_is_none(shown: Shown) -> None:
    found, rows = embedded(shown[0]), shown[1]
    assert (len(found.seconds), found.head["stretches"]) == (2380, 0)
    assert np.allclose(found.seconds, rows["tick"] / 10)
    for name in VALUES:
        assert same(found.values[name], rows[name]), name
    reasons = [
        dict(part.split("=") for part in text.split(";")) if isinstance(text, str) else {}
        for text in rows["reasons"]
    ]
    assert found.why == [
        "".join(f";{name}={one[name]}" for name in VALUES if name in one) for one in reasons
    ]
    assert found.why[500] == ";power_permille=timeout"
    assert found.why[1000] == ";temperature_c=disconnected;power_permille=disconnected"


def test_it_holds_what_the_figure_marks(shown: Shown) -> None:
    found = embedded(shown[0])
    # from when the last answer came to when the next one did
    assert found.lanes["no data"] == [
        (99.915, 103.015, "disconnected"),
        (149.915, 152.014, "no_rows"),
    ]
    assert found.lanes["alarm"] == [(70.0, 72.0, "high")]
    assert [(a, b) for a, b, _ in found.lanes["status"]] == [
        (0.0, 100.0),
        (103.0, 150.0),
        (152.0, 240.0),
    ]
    assert len(found.lanes["joints"]) > 40
    assert found.head["limits"] == [["high", [[-1.0, 380.0]]], ["low", [[-1.0, 300.0]]]]
    assert {celsius for _, _, celsius in found.held} == {350}
    # no outage is bridged
    assert [(a, b) for a, b, _ in found.held] == [(0.0, 95.0), (105.0, 145.0), (155.0, 235.0)]
    assert found.head["start"] == 1_790_000_000.0


def test_beyond_its_share_a_port_has_the_extremes_of_each_stretch_and_the_readings_around_an_alarm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zoom, "MOST_READINGS", 1600)
    folder, rows = recorded(tmp_path)
    found = embedded(write_report(folder).read_text("utf-8"))
    stretches = found.head["stretches"]
    assert stretches == 200
    for name in VALUES:
        values = rows[name].to_numpy(dtype=np.float64, na_value=np.nan)
        of = (rows["tick"].to_numpy() * stretches + stretches // 2400) // 2400
        for number in range(stretches):
            mine = values[of == number]
            mine = mine[~np.isnan(mine)]
            ends = (mine.min(), mine.max()) if len(mine) else (np.nan, np.nan)
            assert np.array_equal(
                ends, (found.low[name][number], found.high[name][number]), equal_nan=True
            ), (name, number)
    kept = rows[rows["tick"].isin(np.round(found.seconds * 10).astype(int))]
    assert 0 < len(found.seconds) == len(kept) <= 800
    for name in VALUES:
        assert same(found.values[name], kept[name]), name
    assert any(a <= 70.0 and b >= 72.0 for a, b in found.head["parts"])  # the alarm
    inside = np.zeros(len(rows), dtype=bool)
    for a, b in found.head["parts"]:
        inside |= (rows["tick"].to_numpy() / 10 >= a - 1e-6) & (
            rows["tick"].to_numpy() / 10 < b - 1e-6
        )
    assert inside.tolist() == rows["tick"].isin(kept["tick"]).tolist()  # the parts say which


def test_a_single_reading_is_seen_in_eight_hours() -> None:
    drawn = traced(288_000)
    drawn.temperature[123_456], drawn.temperature[200_000] = 411.0, 12.0
    found = data(drawn, 96_000)
    assert len(found.high["temperature_c"]) == 12_000
    assert (np.nanmax(found.high["temperature_c"]), np.nanmin(found.low["temperature_c"])) == (
        411,
        12,
    )
    assert int(np.nanargmax(found.high["temperature_c"])) == 123_456 * 12_000 // 288_000


def test_the_readings_around_what_is_gravest_come_first() -> None:
    quiet = replace(
        traced(20_000),
        gaps=[Span(1500.0, 1510.0, "disconnected")],
        joints=[Span(100.0, 101.0, JointEnd.LATE)],
    )
    marked = replace(
        quiet,
        marks=[
            Mark(Span(300.0, 301.0, "high"), MarkKind.ALARM),
            Mark(Span(900.0, 900.0, ""), MarkKind.UNCONFIRMED),
        ],
    )
    assert [[round(a), round(b)] for a, b in data(marked, 1300).head["parts"]] == [[270, 331]]
    assert [[round(a), round(b)] for a, b in data(marked, 2600).head["parts"]] == [
        [270, 331],
        [870, 930],
    ]
    wide = [(round(a), round(b)) for a, b in data(marked, 8000).head["parts"]]
    assert wide == [(85, 116), (270, 331), (870, 930), (1490, 1520)]


def test_the_joints_are_there_and_those_without_recovery_apart() -> None:
    joints = [
        Span(10.0, 11.04, JointEnd.BACK),
        Span(20.0, 20.8, JointEnd.LATE),
        Span(30.0, 45.0, JointEnd.CUT_OFF),
    ]
    found = data(replace(traced(500), joints=joints))
    assert found.lanes["joints"] == [
        (10.0, 11.04, JointEnd.BACK),
        (20.0, 20.8, JointEnd.LATE),
        (30.0, 45.0, JointEnd.CUT_OFF),
    ]


def test_spans_that_are_too_many_are_left_out_and_counted() -> None:
    drawn = replace(
        traced(500),
        joints=[
            Span(one / 100, one / 100 + 0.005, JointEnd.BACK) for one in range(LEAST_SPANS + 1)
        ],
    )
    found = data(drawn, 600)
    assert found.head["left"] == [["joints", LEAST_SPANS + 1]]
    assert "joints" not in found.lanes
    assert "status" in found.lanes


def test_words_from_a_record_are_cleaned_and_cut() -> None:
    drawn = replace(
        traced(50),
        marks=[Mark(Span(1.0, 2.0, "</script>\x1b[2J\u202e" + "x" * 500), MarkKind.UNCONFIRMED)],
    )
    word = data(drawn).lanes["doubtful"][0][2]
    assert word.startswith("</script>")
    assert word.isprintable()
    assert len(word) == LONGEST_WORD


def test_rows_without_a_grid_keep_their_times_to_a_millisecond() -> None:
    drawn = traced(50)
    drawn = replace(
        drawn,
        grid=Grid(drawn.grid.t0_utc_us, None),
        seconds=drawn.seconds[:] + np.linspace(0, 0.04, 50),
    )
    found = data(drawn)
    assert np.abs(found.seconds - (drawn.seconds[:] - drawn.start)).max() <= 0.0005 + 1e-9


def test_nothing_read_is_nothing_to_look_at() -> None:
    drawn = traced(50)
    assert zoom_of(replace(drawn, temperature=np.full(50, np.nan)), 100) is None


@given(st.lists(st.integers(-BOUND, BOUND), max_size=50))
def test_every_number_comes_back(numbers: list[int]) -> None:
    read = Numbers(varints(np.array(numbers, dtype=np.int64)))
    assert [read.next() for _ in numbers] == numbers
    assert read.left == 0


@pytest.mark.parametrize("ports", [1, 4, 32, 128])
def test_all_of_them_together_stay_small(ports: int) -> None:
    assert 0.9 * MOST_READINGS < ports * share(ports) <= MOST_READINGS


def test_eight_hours_of_a_port_take_no_more_than_a_megabyte(tmp_path: Path) -> None:
    columns = samples(288_000)
    drawn = trace(
        pd.DataFrame({**columns, "time": pd.to_datetime(columns["time"], unit="us", utc=True)}),
        Grid(1_790_000_000_000_000, 0.1),
    )
    found = zoom_of(drawn, share(4))
    assert found is not None
    assert len(found) < 1_100_000
    assert zoom_data(found).head["stretches"] == 0


def test_uplot_is_the_released_file_with_its_licence() -> None:
    source = json.loads(UPLOT.joinpath("source.json").read_text("utf-8"))
    names = {entry.name for entry in UPLOT.iterdir()}
    assert names == {"source.json", *source["sha256"]}
    for name, digest in source["sha256"].items():
        assert sha256(UPLOT.joinpath(name).read_bytes()).hexdigest() == digest, name
    assert (
        f"(v{source['version']})"
        in UPLOT.joinpath("uPlot.iife.min.js").read_text("utf-8").splitlines()[0]
    )
    licence = UPLOT.joinpath("LICENSE").read_text("utf-8")
    assert licence.startswith("The MIT License (MIT)")
    assert source["author"] in licence
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
        "license-files"
    ]
    assert "jbclog/report/vendor/uplot/LICENSE" in declared


def test_the_page_carries_uplots_licence_and_only_where_there_is_a_view(
    shown: Shown, tmp_path: Path
) -> None:
    assert UPLOT.joinpath("LICENSE").read_text("utf-8").strip() in shown[0]
    silent = station(ports=(1,))
    silent.outcome, silent.touched, silent.safe_state = "refused", [], {}
    bare = write_report(seal(tmp_path, [silent], table())).read_text("utf-8")
    assert "uPlot" not in bare
    assert "<script" not in bare


def test_hot_air_has_the_work_below_it_its_flow_and_suction() -> None:
    made = samples(600)
    work = np.round(60 + 100 * np.abs(np.sin(np.arange(600) / 200 * np.pi)))
    flow = np.where(np.arange(600) % 50 == 0, 600.0, np.nan)
    sucks = ((np.arange(600) > 100) & (np.arange(600) <= 120)).astype(np.float64)
    made |= {
        "external_c": work,
        "set_flow_permille": flow,
        "desoldering": sucks,
        "cooling": np.zeros(600),
    }
    found = data(trace(table(made).to_pandas(), Grid(1_790_000_000_000_000, 0.1), of_air=True))
    assert found.values["external_c"].tolist() == work.tolist()
    assert [word for _, _, word in found.lanes["flow"]] == ["600 ‰"]
    assert found.lanes["suction"] == [(10.1, 12.1, "suction")]
