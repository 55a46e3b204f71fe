"""Many runs: found by their manifests, lazily, read piece by piece; and how notebooks show one and
many.
"""

from __future__ import annotations

import inspect
import re
import shutil
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pytest

import jbclog
from jbclog.core.errors import RecordError, UsageError
from jbclog.record import find_runs
from jbclog.record.manifest import Metadata
from jbclog.report.write import write_report
from support.faults.hostile_names import HOSTILE, MOVES
from support.records import few_rows, sealed_run, small_run

OF_EACH = (
    "samples",
    "events",
    "settings",
    "counters",
    "joints",
    "metrics",
    "alarms",
    "units",
    "gaps",
    "tips",
    "accounting",
)
"""Methods of `Run` and of `Runs`."""


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three runs: two of one line with two stations, one of another order."""
    out = tmp_path_factory.mktemp("runs")
    for _ in range(2):
        small_run.make_run(out, 20.0)
    rows = sealed_run.samples(700)
    said = Metadata(
        "A. Rossi", "88123", "controller", units=["SN-1"], tags={"shift": "late"}, tips=["T-1"]
    )
    sealed_run.seal(out, [sealed_run.station(rows=700)], sealed_run.table(rows), metadata=said)
    return out


def test_runs_are_found_by_their_metadata(home: Path) -> None:
    assert len(jbclog.open_runs(home)) == 3
    assert [run.name for run in jbclog.open_runs(home, order="88123")] == [
        "20260921T141320Z-bench-k7qd"
    ]
    assert (
        len(
            jbclog.open_runs(
                home, unit="SN-*", tags={"shift": "late"}, operator="A. Rossi", product="controller"
            )
        )
        == 1
    )
    assert len(jbclog.open_runs(home, line="bench", recipe="sn100c-tht@7", station="dde-1")) == 3
    assert len(jbclog.open_runs(home, station="ale-1")) == 2
    assert len(jbclog.open_runs(home, since="2026-09-22")) == 0
    assert (
        len(jbclog.open_runs(home, since="2026-09-21", until=pd.Timestamp("2026-09-22", tz="UTC")))
        == 3
    )


def test_an_unknown_filter_and_a_missing_folder_are_errors(home: Path) -> None:
    with pytest.raises(UsageError, match=r"colour.*by flux_lot"):
        jbclog.open_runs(home, colour="red")
    with pytest.raises(UsageError, match="must be one of running, crashed, ended"):
        jbclog.open_runs(home, state="sealed")
    with pytest.raises(RecordError, match="is missing"):
        jbclog.open_runs(home / "nothing")


def test_nothing_is_read_before_it_is_asked_for(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []
    summary_of = find_runs.summary_of
    monkeypatch.setattr(
        find_runs,
        "summary_of",
        lambda folder, wanted: read.append(folder) or summary_of(folder, wanted),
    )
    runs = jbclog.open_runs(home, line="bench")
    assert read == []
    assert len(runs) == len(list(runs)) == 3
    assert len(read) == 3  # once, not at each question
    assert len(runs.refreshed()) == 3
    assert len(read) == 6


def test_they_are_a_sequence(home: Path) -> None:
    runs = jbclog.open_runs(home)
    assert runs[0].name == next(iter(runs)).name
    assert [run.name for run in runs[1:]] == [run.name for run in runs][1:]
    assert repr(runs) == f"<Runs {home}: 3 runs>"


@pytest.mark.parametrize("part", [slice(-2, None), slice(None, None, -1), slice(7, None)])
def test_a_slice_has_the_calls_of_all_runs(home: Path, part: slice) -> None:
    runs = jbclog.open_runs(home)
    names = [run.name for run in runs][part]
    assert [run.name for run in runs[part]] == names
    assert [*runs[part].metrics()["run"].unique()] == names
    assert len(runs[part].refreshed()) == 3


def test_manifests_are_a_row_a_run(home: Path) -> None:
    table = jbclog.open_runs(home).manifests().set_index("run")
    one = table.loc["20260921T141320Z-bench-k7qd"]
    assert (one["order"], one["units"], one["exit_code"]) == ("88123", ("SN-1",), 0)
    assert pd.isna(one["verdict"])
    assert str(table["start"].dtype) == "datetime64[us, UTC]"
    assert table["exit_code"].dtype == "Int64"
    none = jbclog.open_runs(home, order="none").manifests()
    assert (len(none), list(none.columns)) == (0, list(jbclog.open_runs(home).manifests().columns))


def own_rows(rows: pd.DataFrame, run: jbclog.Run) -> pd.DataFrame:
    """The rows of one run, without its name, which `Run` gives for some tables."""
    mine = rows[rows["run"] == run.name].reset_index(drop=True)
    return mine.drop(columns="run")


@pytest.mark.parametrize("name", OF_EACH)
def test_the_rows_of_all_runs_are_those_of_each_with_its_name(home: Path, name: str) -> None:
    runs = jbclog.open_runs(home)
    whole = getattr(runs, name)()
    with_rows = [run.name for run in runs if len(getattr(run, name)())]
    assert list(whole["run"].unique()) == with_rows != []
    assert whole.columns[0] == "run"
    assert list(whole.index) == list(range(len(whole)))
    for run in runs:
        expected = getattr(run, name)().drop(columns="run", errors="ignore")
        pd.testing.assert_frame_equal(own_rows(whole, run), expected)


@pytest.mark.parametrize("name", OF_EACH)
def test_without_a_run_the_columns_and_their_types_are_the_same(home: Path, name: str) -> None:
    none = getattr(jbclog.open_runs(home, order="none"), name)()
    assert len(none) == 0
    pd.testing.assert_series_equal(none.dtypes, getattr(jbclog.open_runs(home), name)().dtypes)


def test_what_is_chosen_is_chosen_in_each(home: Path) -> None:
    runs = jbclog.open_runs(home)
    columns = ["tick", "setpoint_c"]
    whole = runs.samples("dde-1", 1, columns=columns, setpoint="in force")
    assert list(whole.columns) == ["run", *columns]
    for run in runs:
        mine = run.samples("dde-1", 1, columns=columns, setpoint="in force")
        pd.testing.assert_frame_equal(own_rows(whole, run), mine)
    assert set(runs.events(kind="alarm.*")["kind"]) <= {"alarm.high", "alarm.high.ended"}
    assert set(runs.settings("ale-1", 1)["station"]) == {"ale-1"}


@pytest.mark.parametrize("name", OF_EACH)
def test_runs_without_a_station_are_left_out_and_one_that_none_has_is_refused(
    home: Path, name: str
) -> None:
    runs = jbclog.open_runs(home)
    read = getattr(runs, name)
    if "station" not in inspect.signature(read).parameters:
        return
    assert read("ale-1")["run"].nunique() <= 2
    with pytest.raises(UsageError, match=r"no run has a station 'nobody'; there are .*dde-1"):
        read("nobody")
    with pytest.raises(UsageError, match=r"no run has a port 7 of 'dde-1'; there are 1, 2"):
        read("dde-1", 7)
    with pytest.raises(UsageError, match=r"port must be a number, such as 1 \(got '1'\)"):
        read("dde-1", "1")


def test_a_mistake_is_refused_as_in_a_run(home: Path) -> None:
    runs = jbclog.open_runs(home)
    with pytest.raises(UsageError, match="no column colour; it has "):
        runs.samples(columns=["colour"])
    with pytest.raises(UsageError, match="no time with a date"):
        runs.events(start="20:22")
    with pytest.raises(UsageError, match="there is no table 'rows'; there are samples, events"):
        list(runs.stream("rows"))


def test_processes_read_the_same(home: Path) -> None:
    alone, together = jbclog.open_runs(home), jbclog.open_runs(home, processes=2)
    pd.testing.assert_frame_equal(
        together.counters("dde-1", 2), alone.counters("dde-1", 2), check_names=True
    )


def test_a_run_that_cannot_be_read_is_an_error_and_not_left_out(tmp_path: Path) -> None:
    folder = small_run.make_run(tmp_path, 5.0)
    runs = jbclog.open_runs(tmp_path)
    assert len(runs) == 1
    (part,) = (folder / "events").glob("*.parquet")
    part.write_bytes(part.read_bytes()[:-7])
    for read in (runs.events, lambda: list(runs.stream("events"))):
        with pytest.raises(RecordError, match="part-0000"):
            read()


def test_metrics_of_a_report_are_those_of_the_run_without_measuring_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = small_run.make_run(tmp_path, 5.0)
    ((_, computed),) = jbclog.open_runs(tmp_path).metric_rows()
    write_report(folder)
    monkeypatch.setattr("jbclog.analysis.run_metrics.computed_metrics", None)
    ((_, stored),) = jbclog.open_runs(tmp_path).metric_rows()
    assert stored == computed
    ((_, only),) = jbclog.open_runs(tmp_path).metric_rows("ale-1")
    assert only == [row for row in computed if row.station == "ale-1"]


def test_a_manifest_that_is_changed_after_the_search_is_noticed(tmp_path: Path) -> None:
    folder = small_run.make_run(tmp_path, 5.0)
    write_report(folder)
    runs = jbclog.open_runs(tmp_path)
    assert len(runs) == 1
    manifest = folder / "manifest.json"
    manifest.write_bytes(manifest.read_bytes().replace(b'"success"', b'"aborted"'))
    with pytest.raises(RecordError, match="was changed"):
        runs.metrics()


def test_a_folder_that_cannot_be_read_is_named_and_the_others_are_there(tmp_path: Path) -> None:
    small_run.make_run(tmp_path, 5.0)
    (tmp_path / "20260921T141320Z-bench-aaaa").mkdir()
    runs = jbclog.open_runs(tmp_path)
    assert (len(runs), len(runs.unreadable)) == (1, 1)
    assert "1 unreadable" in repr(runs)


def test_a_run_that_several_folders_have_is_there_once(tmp_path: Path) -> None:
    folder = small_run.make_run(tmp_path, 5.0)
    alone = jbclog.open_runs(tmp_path)
    assert alone.copies == []
    copy = shutil.copytree(folder, tmp_path / "0 copy")
    runs = jbclog.open_runs(tmp_path)
    assert [run.folder for run in runs] == [folder]
    pd.testing.assert_frame_equal(runs.metrics(), alone.metrics())
    (one,) = runs.copies
    assert (one.folder, one.counted, one.is_same) == (copy, folder, True)
    assert repr(runs) == f"<Runs {tmp_path}: 1 run, 1 copied>"
    assert "1 folder with a run of another one (.copies)" in runs._repr_html_()


# -- piece by piece --------------------------------------------------------------------------------


def test_a_stream_is_the_table(home: Path) -> None:
    for run in jbclog.open_runs(home):
        for table, whole in (
            ("samples", run.samples()),
            ("events", run.events()),
            ("counters", run.counters()),
        ):
            pieces = list(run.stream(table))
            together = pd.concat(pieces, ignore_index=True) if pieces else whole.head(0)
            pd.testing.assert_frame_equal(together, whole)


def test_a_stream_of_a_run_that_is_open_has_what_is_not_sealed_yet(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    few_rows.hand_over(store, range(70))
    store.commit_now()
    ticks = [
        tick
        for piece in jbclog.open_run(store.folder).stream(columns=["tick"])
        for tick in piece["tick"]
    ]
    few_rows.vanish(store)
    assert ticks == list(range(70))


def test_only_parts_of_the_time_asked_for_are_read(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = jbclog.open_runs(home, order="88123")[0]
    times = run.samples(columns=["time"])["time"]
    read: list[Path] = []
    from jbclog.analysis import run_tables as module

    groups_of = module.groups_of
    monkeypatch.setattr(
        module,
        "groups_of",
        lambda parts, columns, **how: read.extend(parts) or groups_of(parts, columns, **how),
    )
    assert len(run.samples(start=times.iloc[-1])) == 1
    assert len(read) == 1
    assert len(run.samples(start=times.iloc[-1] + pd.Timedelta(microseconds=1))) == 0
    assert len(run.samples(stop=times.iloc[0])) == 0
    assert len(read) == 1
    assert len(run.samples(stop=times.iloc[1], columns=["tick"])) == 1


def test_a_stream_reads_no_further_than_it_is_asked(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from jbclog.analysis import run_tables as module

    given: list[int] = []

    def groups(parts: list[Path], columns: list[str], **how: bool) -> Iterator[pa.Table]:
        for group in groups_of(parts, columns, **how):
            for place in range(0, len(group), 100):
                given.append(place)
                yield group[place : place + 100]

    groups_of = module.groups_of
    monkeypatch.setattr(module, "groups_of", groups)
    pieces = jbclog.open_runs(home).stream(columns=["tick"])
    assert given == []
    assert len(next(pieces)) == 100
    assert given == [0]
    next(pieces)
    assert given == [0, 100]


def test_the_pieces_of_all_runs_are_the_whole_table(home: Path) -> None:
    runs = jbclog.open_runs(home)
    for table in ("samples", "counters"):
        pieces = list(runs.stream(table, "dde-1", 1))
        assert all(len(piece) for piece in pieces)
        whole = getattr(runs, table)("dde-1", 1)
        pd.testing.assert_frame_equal(pd.concat(pieces, ignore_index=True), whole)
    assert list(jbclog.open_runs(home, order="none").stream()) == []
    with pytest.raises(UsageError, match="no run has a station 'nobody'"):
        runs.stream("samples", "nobody")
    with pytest.raises(UsageError, match="no run has a port 7"):
        next(runs.stream("samples", "dde-1", 7))


# -- in a notebook ---------------------------------------------------------------------------------


class Seen(HTMLParser):
    """Which elements and attributes a page has."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}


TAGS = {"div", "b", "p", "table", "thead", "tbody", "tr", "th", "td"}


def test_they_show_what_matters(home: Path) -> None:
    runs = jbclog.open_runs(home)
    shown = runs._repr_html_()
    assert "3 runs in" in shown
    assert shown.count("<tr>") == 4
    one = runs[0]._repr_html_()
    assert all(text in one for text in ("dde-1", "sn100c-tht@7", "UTC"))


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_texts_are_only_shown(tmp_path: Path, name: str) -> None:
    text = HOSTILE[name]
    said = Metadata(text, text, text, units=[text, text], tags={text: text})
    sealed_run.seal(
        tmp_path,
        [sealed_run.station(rows=2)],
        sealed_run.table(sealed_run.samples(2)),
        metadata=said,
        verdict=text,
    )
    runs = jbclog.open_runs(tmp_path)
    for shown in (runs._repr_html_(), runs[0]._repr_html_()):
        seen = Seen(shown)
        assert seen.tags <= TAGS
        assert seen.attributes == set()
        assert not MOVES.search(shown)
        assert re.search("\\n", shown) is None
