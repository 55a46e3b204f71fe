"""`run.gaps()`: of a run in progress as far as it is committed, the same when it is sealed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from support.product import GAPS_SCHEMA, UsageError, gap_rows, open_run
from support.records.live_rows import NAME, PERIOD_S, Recording
from support.records.sealed_run import lose, samples, seal, station, table

LOST: dict[str, Any] = {
    "temperature_c": None,
    "quality": "timeout",
    "reasons": "temperature_c=timeout",
}
NAMES = [
    *("run", "station", "port", "signal", "start", "stop"),
    *("seconds", "missing", "reasons", "at_least"),
]


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Recording]:
    begun = Recording(tmp_path)
    yield begun
    begun.abandon()


def record(recording: Recording, count: int, **columns: Any) -> None:
    """Hand over the next rows of each port, a period apart."""
    for _ in range(count):
        time_us = recording.began_us + round(recording.tick * PERIOD_S * 1e6)
        for port in recording.ports:
            recording.store.sample(recording.row(port, time_us, **columns))
        recording.tick += 1


def told(gaps: pd.DataFrame) -> list[tuple[Any, ...]]:
    columns = gaps[["port", "signal", "missing", "reasons", "at_least"]]
    return [tuple(row) for row in columns.itertuples(index=False)]


def test_a_run_in_progress_has_the_gaps_of_what_is_committed(recording: Recording) -> None:
    run = open_run(recording.folder)
    recording.facts.last_tick = 99  # the session is further than what is committed
    recording.store.facts(recording.facts)
    record(recording, 5)
    record(recording, 3, **LOST)
    recording.commit()
    open_ended = run.gaps(NAME, 1)
    assert told(open_ended) == [(1, "temperature_c", 3, "timeout", True)]
    assert open_ended.attrs["until"] == run.samples()["time"].max()
    recording.seal_part()
    assert told(run.gaps(NAME, 1)) == told(open_ended)

    record(recording, 2)
    recording.commit()
    closed = run.gaps()
    assert told(closed) == [(port, "temperature_c", 3, "timeout", False) for port in (1, 2)]
    recording.facts.last_tick = 9
    recording.finalize()
    sealed = run.gaps()
    pd.testing.assert_frame_equal(sealed, closed)
    assert sealed.attrs == {}


def test_one_station_port_or_signal(tmp_path: Path) -> None:
    columns, other = samples(600), samples(600)
    lose(columns, slice(100, 130))
    lose(other, slice(300, 301), "timeout")
    other["port"][:] = 2
    ports = [station(rows=600, ports=(1, 2))]
    run = open_run(seal(tmp_path, ports, table(columns, other)))
    every = run.gaps()
    assert list(every.columns) == NAMES
    assert set(every["run"]) == {run.name}
    assert set(every["port"]) == {1, 2}
    first = every[every["port"] == 1].reset_index(drop=True)
    pd.testing.assert_frame_equal(run.gaps(port=1), first)
    alone = every[every["signal"] == "temperature_c"].reset_index(drop=True)
    pd.testing.assert_frame_equal(run.gaps(signal="temperature_c"), alone)
    lengths = run.gaps(signal="temperature_c")["seconds"].tolist()
    assert lengths == [pytest.approx(31 * PERIOD_S, abs=0.05), pytest.approx(0.2, abs=0.05)]
    assert gap_rows(run).schema.equals(GAPS_SCHEMA)
    assert gap_rows(run).num_rows == len(every)


def test_mistakes_name_what_there_is(tmp_path: Path) -> None:
    run = open_run(seal(tmp_path, [station(rows=60)], table(samples(60))))
    assert run.gaps().empty
    with pytest.raises(UsageError, match="no station 'dde-9'"):
        run.gaps("dde-9")
    with pytest.raises(UsageError, match="no port 7"):
        run.gaps(port=7)
    with pytest.raises(UsageError, match="no signal 'heat'; there are temperature_c, power_perm"):
        run.gaps(signal="heat")
