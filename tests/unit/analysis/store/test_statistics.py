"""Statistics of a store are those of its rows, in groups that somebody chooses; a part of a table
that is missing is an error.
"""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import pandas as pd
import pytest
from deltalake import DeltaTable

import jbclog
from jbclog.analysis.fleet.moments import QUANTILE_ERROR
from jbclog.analysis.fleet.processes import Processes
from jbclog.analysis.store import parts, statistics
from jbclog.analysis.store.place import Place
from jbclog.analysis.store.reader import Store
from jbclog.analysis.store.statistics import Part, finish, partial
from jbclog.app.publish.upkeep import compact
from jbclog.core.errors import RecordError, UsageError
from support.records.many_runs import one_run, told
from support.records.plant_store import published

FIGURES = ["mean", "sd", "min", "max"]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    home = tmp_path_factory.mktemp("runs")
    for number, tips in enumerate((["dde-1=T-1"], ["dde-1:1=T-2"], [])):
        one_run(home, number, 0.3 * number, metadata=told(tips=tips, order="88123"))
    return published(tmp_path_factory.mktemp("plant") / "store", home)


@pytest.mark.parametrize("by", [("station", "port"), ("run",), ("tip",), ("line", "run", "tip")])
@pytest.mark.parametrize(
    ("table", "column"), [("samples", "temperature_c"), ("joints", "recovery_s")]
)
def test_they_are_those_of_the_rows(
    place: Place, table: str, column: str, by: tuple[str, ...]
) -> None:
    runs = jbclog.open_runs(place.url)
    tips = dict(zip([run.name for run in runs], ("T-1", "T-2", None), strict=True))
    whole = pd.concat(
        [getattr(run, table)().assign(run=run.name, line=run.manifest.line.name) for run in runs]
    )
    whole["tip"] = whole["run"].map(tips)
    expected = whole.groupby([*by], dropna=False, sort=True)[column].agg(
        ["count", "mean", "std", "min", "max", _ranked]
    )
    found = runs.statistics(table, column, by)
    assert [tuple(map(str, row)) for row in found[[*by]].itertuples(index=False)] == [
        tuple(map(str, key if isinstance(key, tuple) else (key,))) for key in expected.index
    ]
    assert found["n"].tolist() == expected["count"].tolist()
    for name, theirs in zip(FIGURES, ("mean", "std", "min", "max"), strict=True):
        assert found[name].tolist() == pytest.approx(expected[theirs].tolist(), rel=1e-12)
    assert found["p95"].tolist() == pytest.approx(
        expected["_ranked"].tolist(), rel=found.attrs["quantile_error"]
    )
    assert found.attrs["quantile_error"] == QUANTILE_ERROR


def _ranked(values: pd.Series) -> float:
    known = sorted(values.dropna())
    return float(known[max(1, -(-len(known) * 95 // 100)) - 1])


def test_parts_of_a_file_in_any_order_and_in_processes_give_the_same(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store(place)
    runs, by = store.runs(), ("station", "port")
    expected = finish(partial_of([*_tasks(store, by)]), by)
    monkeypatch.setattr(parts, "PART_ROWS", 50)
    tasks = [*_tasks(store, by)]
    assert len(tasks) == sum(-(-one.rows["samples"] // 50) for one in runs)
    pd.testing.assert_frame_equal(finish(partial_of(tasks[::-1]), by), expected, check_exact=True)
    monkeypatch.setattr(statistics, "engine_of", lambda *_, **__: Processes(2))
    pd.testing.assert_frame_equal(
        jbclog.open_runs(place.url).statistics(by=by), expected, check_exact=True
    )


def test_small_files_are_read_together_without_what_only_the_runs_need(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, by = Store(place), ("station", "port")
    runs = store.runs()
    (task,) = _tasks(store, by)
    assert len(task.rows.files) == len(runs) == 3
    assert task.owners.keys() == {one.record for one in runs}
    assert all(b"88123" not in pickle.dumps(one) for one in (task, task.owners))
    expected = finish(partial(task), by)
    for name, value in (("MOST_FILES", 2), ("PART_ROWS", 2 * runs[0].rows["samples"])):
        with monkeypatch.context() as patch:
            patch.setattr(parts, name, value)
            tasks = [*_tasks(store, by)]
        assert [len(one.rows.files) for one in tasks] == [2, 1], name
        pd.testing.assert_frame_equal(finish(partial_of(tasks), by), expected, check_exact=True)


def _tasks(store: Store, by: tuple[str, ...]) -> list[statistics.Task]:
    runs = store.runs()
    return [*statistics._tasks(parts.parts_of(store, "samples", runs), runs, "temperature_c", by)]


def partial_of(tasks: list[statistics.Task]) -> Part:
    whole = Part()
    for task in tasks:
        whole.add(partial(task))
    return whole


def test_joints_of_other_rules_are_found_anew(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = jbclog.open_runs(place.url)
    expected = runs.statistics("joints", "dwell_s", ["run"])
    for module in (statistics, __import__("jbclog.analysis.store.run", fromlist=["RULES"])):
        monkeypatch.setattr(module, "RULES", 10_000)
    found = jbclog.open_runs(place.url).statistics("joints", "dwell_s", ["run"])
    pd.testing.assert_frame_equal(found, expected, check_exact=True)


def test_rows_of_other_runs_in_the_same_file_do_not_count(tmp_path: Path) -> None:
    for number in range(3):
        one_run(tmp_path / "runs", number, 5.0 * number, rows=300 + 10 * number)
    place = published(tmp_path / "store", tmp_path / "runs")
    whole = jbclog.open_runs(place.url).statistics(by=["run"])
    [*compact(place)]
    assert len(DeltaTable(place.of("samples")).file_uris()) == 1
    (name,) = (
        run.name
        for run in jbclog.open_runs(place.url, since="2026-09-21T06:30", until="2026-09-21T07:30")
    )
    part = jbclog.open_runs(place.url, since="2026-09-21T06:30", until="2026-09-21T07:30")
    pd.testing.assert_frame_equal(
        part.statistics(by=["run"]),
        whole[whole["run"] == name].reset_index(drop=True),
        check_exact=True,
    )
    assert [
        one.folder.name for one, rows in part.metric_rows(names=["idle_error_c"]) if len(rows) == 1
    ] == [name]


def test_a_part_that_is_missing_is_no_shorter_answer(tmp_path: Path) -> None:
    one_run(tmp_path / "runs", 0)
    place = published(tmp_path / "store", tmp_path / "runs")
    runs = jbclog.open_runs(place.url)
    DeltaTable(place.of("samples")).delete("row < 5")
    with pytest.raises(
        RecordError,
        match=r"its samples are incomplete: 295 of 300 rows are there; `jbclog store check",
    ):
        runs.statistics()


@pytest.mark.parametrize(
    ("table", "column", "by", "sentence"),
    [
        ("events", "port", ["run"], "statistics of samples and joints, not of 'events'"),
        ("samples", "colour", ["run"], "samples has no numbers 'colour'; it has .*temperature_c"),
        ("samples", "quality", ["run"], "samples has no numbers 'quality'"),
        (
            "samples",
            "temperature_c",
            ["room"],
            r"groups are some of run, line, station, port, tip, each once (got room)",
        ),
        ("samples", "temperature_c", [], "(got none)"),
        ("samples", "temperature_c", ["run", "run"], "(got run, run)"),
    ],
)
def test_what_is_no_table_column_or_group_is_an_error(
    place: Place, table: str, column: str, by: list[str], sentence: str
) -> None:
    with pytest.raises(UsageError) as caught:
        jbclog.open_runs(place.url).statistics(table, column, by)
    assert sentence in str(caught.value) or re.search(sentence, str(caught.value))
