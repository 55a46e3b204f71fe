"""A run as DataFrames: sealed, being recorded, cut off; without writing into it and without making
the recorder wait.
"""

from __future__ import annotations

import threading
import warnings
from datetime import UTC, datetime
from pathlib import Path

import pandas as pd
import pytest

import jbclog
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.rows import TABLES
from jbclog.record.conclude import conclude
from jbclog.record.manifest import Manifest, Metadata
from jbclog.record.recover import recover
from jbclog.record.schema import SCHEMAS
from jbclog.record.seal import seal_journal
from support.command import until
from support.product import lose_commit, seal_part
from support.records import event_run, few_rows, small_run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_run.make_run(tmp_path_factory.mktemp("runs"), 40.0)


@pytest.fixture
def run(folder: Path) -> jbclog.Run:
    return jbclog.open_run(folder)


def test_all_tables_have_their_columns(run: jbclog.Run) -> None:
    frames = {table: getattr(run, table)() for table in TABLES}
    for table, frame in frames.items():
        assert list(frame.columns) == SCHEMAS[table].names
        assert len(frame)
    assert len(frames["samples"]) == 3 * 400


def test_types_know_missing_values(run: jbclog.Run) -> None:
    samples = run.samples(station="ale-1")
    gone = samples[samples["quality"] == "disconnected"]
    assert len(gone) == 30
    assert gone["temperature_c"].isna().all()
    assert samples["temperature_c"].dtype == "Int64"
    assert samples["alarm_high"].dtype == "boolean"
    assert samples["tick"].dtype == "int64"
    assert str(samples["time"].dtype) == "datetime64[us, UTC]"


def test_they_are_what_pandas_reads_by_itself(run: jbclog.Run) -> None:
    pd.testing.assert_frame_equal(run.samples(), pd.read_parquet(run.folder / "samples"))


def test_by_station_and_port(run: jbclog.Run) -> None:
    assert set(run.samples(station="dde-1")["port"]) == {1, 2}
    only = run.samples("dde-1", 2, columns=["setpoint_c", "tick"])
    assert list(only.columns) == ["setpoint_c", "tick"]
    assert len(only) == 400
    assert set(only["setpoint_c"].dropna()) == {330}
    assert set(run.events(station="ale-1")["kind"]) >= {"link.lost", "link.back"}
    assert len(run.settings("ale-1")) == 3
    assert len(run.counters("ale-1")) == 2 * 5


@pytest.mark.parametrize(
    "method",
    [
        "samples",
        "stream",
        "events",
        "settings",
        "counters",
        "wire",
        "joints",
        "each_joint",
        "metrics",
        "plot",
    ],
)
def test_an_unknown_station_is_an_error_with_the_known_ones(run: jbclog.Run, method: str) -> None:
    named = {"station": "nobody"}
    with pytest.raises(UsageError, match="has no station 'nobody'; it has ale-1, dde-1"):
        getattr(run, method)(**named)


@pytest.mark.parametrize("method", ["samples", "stream", "each_joint", "plot"])
def test_an_unknown_port_is_an_error_with_the_known_ones(run: jbclog.Run, method: str) -> None:
    with pytest.raises(UsageError, match="dde-1 has no port 7; it has 1, 2"):
        getattr(run, method)(station="dde-1", port=7)
    with pytest.raises(UsageError, match="has no port 7; it has 1, 2"):
        getattr(run, method)(port=7)
    with pytest.raises(UsageError, match=r"port must be a number, such as 1 \(got '1'\)"):
        getattr(run, method)(station="dde-1", port="1")


@pytest.mark.parametrize("zone", ["", "Z", "+00:00"])
def test_by_time_the_start_included_and_the_stop_not(run: jbclog.Run, zone: str) -> None:
    times = run.samples(columns=["time"])["time"]
    start, stop = times[100], times[200]
    text = start.strftime("%Y-%m-%dT%H:%M:%S.%f") + zone
    found = run.samples(start=text, stop=stop)["time"]
    assert found.min() == start
    assert found.max() < stop
    same = run.samples(
        start=start.to_pydatetime(), stop=datetime.fromtimestamp(stop.timestamp(), UTC)
    )
    assert len(same) == len(found)
    madrid = start.tz_convert("Europe/Madrid")
    assert len(run.samples(start=madrid, stop=stop)) == len(found)


def test_an_unknown_column_is_an_error_with_the_known_ones(run: jbclog.Run) -> None:
    with pytest.raises(UsageError, match="no column colour; it has run, seq, time, tick"):
        run.samples(columns=["colour"])


def test_the_manifest(run: jbclog.Run) -> None:
    assert run.manifest.verdict == "REJECT"
    assert run.manifest.station("dde-1").model == "DDE"  # type: ignore[union-attr]  # it is there
    assert run.manifest.station("nobody") is None
    assert repr(run) == f"<Run {run.name}: sealed, REJECT>"


@pytest.mark.parametrize("name", ["missing", "empty", "file"])
def test_what_is_no_run(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError):
        jbclog.open_run(tmp_path / name)


# -- not sealed ------------------------------------------------------------------------------------


def test_a_run_that_is_being_recorded_grows(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    run = jbclog.open_run(store.folder)
    few_rows.hand_over(store, range(50))
    store.commit_now()
    assert list(run.samples()["tick"]) == list(range(50))
    seal_part(store.folder)
    few_rows.hand_over(store, range(50, 80))
    store.commit_now()
    assert list(run.samples()["tick"]) == list(range(80))
    assert list(run.events()["code"]) == list(range(0, 80, 7))
    store.close()
    seal_journal(store.folder)
    conclude(store.folder, Manifest(store.folder.name), store.lock)
    assert list(run.samples()["tick"]) == list(range(80))


def test_a_run_that_crashed_is_read_without_touching_it(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    run = jbclog.open_run(folder)
    assert list(run.samples()["tick"]) == list(range(150))
    assert run.manifest.state == "open"
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    recover(folder)
    assert list(run.samples()["tick"]) == list(range(150))
    assert run.manifest.exit_status == "lost"


def test_a_run_that_is_closed_and_not_yet_sealed(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    few_rows.hand_over(store, range(30))
    store.close()
    before = {path.name for path in store.folder.iterdir()}
    assert list(jbclog.open_run(store.folder).samples()["tick"]) == list(range(30))
    assert {path.name for path in store.folder.iterdir()} == before
    store.release()


def test_damage_is_reported(tmp_path: Path) -> None:
    folder = few_rows.abandoned(tmp_path)
    lose_commit(folder, "samples", 0)
    with pytest.warns(UserWarning, match=r"live-0000\.journal, commit"):
        assert list(jbclog.open_run(folder).samples()["tick"]) == list(range(50, 150))


def test_every_look_at_a_run_while_it_is_sealed_sees_each_row_once(tmp_path: Path) -> None:
    """A reader continues while parts appear, segments disappear and the run is concluded."""
    store = few_rows.begun(tmp_path)
    committed, done, seen = [0], threading.Event(), []

    def look() -> None:
        run = jbclog.open_run(store.folder)
        while not done.is_set():
            least = committed[0]
            ticks = list(run.samples(columns=["tick"])["tick"])
            seen.append((least, ticks))

    def be_looked_at() -> None:  # however seldom a busy machine lets the other thread look
        before = len(seen)
        until(lambda: len(seen) > before)

    def record() -> None:
        for number in range(0, 1000, 20):
            few_rows.hand_over(store, range(number, number + 20))
            store.commit_now()
            committed[0] = number + 20
            if number % 200 == 100:
                be_looked_at()
                seal_part(store.folder)
        be_looked_at()
        store.close()
        seal_journal(store.folder)
        conclude(store.folder, Manifest(store.folder.name), store.lock)
        done.set()

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        writer = threading.Thread(target=record)
        writer.start()
        look()
        writer.join()
    assert len(seen) > 5
    for least, ticks in seen:
        assert ticks == list(range(len(ticks)))
        assert len(ticks) >= least


# -- the plot --------------------------------------------------------------------------------------


def test_the_plot_shows_each_port_with_its_gap_as_the_report_does(
    run: jbclog.Run, tmp_path: Path
) -> None:
    figure = run.plot()
    assert [text.get_text() for text in figure.texts] == [
        "ale-1 port 1",
        "dde-1 port 1",
        "dde-1 port 2",
    ]
    ports = [
        [axes for axes in figure.axes if axes.get_label() == text.get_text()]
        for text in figure.texts
    ]
    assert [len(panels) for panels in ports] == [3, 3, 3]  # temperature, power, lanes
    gaps = [
        sum(one.get_gid() == "gap" for axes in panels for one in axes.patches) for panels in ports
    ]
    assert gaps == [2, 0, 0]
    figure.savefig(tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000


def test_times_can_be_marked_in_the_plot(run: jbclog.Run) -> None:
    axes = run.plot("dde-1", 1).axes[0]
    start, stop = pd.to_datetime(axes.get_xlim(), unit="D", utc=True)
    times = run.samples("dde-1", 1)["time"]
    assert abs((start - times.iloc[0]).total_seconds()) < 1
    assert abs((stop - times.iloc[-1]).total_seconds()) < 1


def test_nothing_to_plot(tmp_path: Path) -> None:
    run = jbclog.open_run(event_run.run_with(tmp_path, [], Metadata()))
    with pytest.raises(UsageError, match="no samples"):
        run.plot()
