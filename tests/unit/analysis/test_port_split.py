"""Rows of many ports, split by station and port."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from jbclog.analysis.port_split import ROWS_OF_A_PORT, by_port, gathered, sorted_by_port
from jbclog.core.rows import PortKey

STATIONS = [f"dde-{number}" for number in range(300)]


def rows_of(count: int, stations: int, ports: int, seed: int, *, coded: bool = True) -> pa.Table:
    """Rows whose `tick` is their number in the whole."""
    rng = np.random.default_rng(seed)
    names = pa.array([STATIONS[one] for one in rng.integers(0, stations, count)], pa.string())
    return pa.table(
        {
            "station": names.dictionary_encode() if coded else names,
            "port": rng.integers(1, ports + 1, count),
            "tick": np.arange(count),
        }
    )


def expected(rows: pa.Table) -> dict[PortKey, list[int]]:
    found: dict[PortKey, list[int]] = {}
    for row in rows.to_pylist():
        found.setdefault((row["station"], row["port"]), []).append(row["tick"])
    return found


@pytest.mark.parametrize("coded", [True, False])
@pytest.mark.parametrize(("stations", "ports"), [(1, 1), (1, 4), (7, 2), (300, 1), (2, 400)])
def test_each_port_has_its_rows_in_their_order(stations: int, ports: int, coded: bool) -> None:
    rows = rows_of(3000, stations, ports, 1, coded=coded)
    assert {key: own["tick"].to_pylist() for key, own in by_port(rows)} == expected(rows)
    wanted = {("dde-0", 1), ("dde-1", 2), ("dde-299", 1), ("dde-7", 7)}
    found, places = sorted_by_port(rows, wanted)
    ticks = found["tick"].to_pylist()
    assert {key: ticks[place] for key, place in places} == {
        key: own for key, own in expected(rows).items() if key in wanted
    }


def test_no_rows_have_no_port() -> None:
    assert [*by_port(rows_of(0, 1, 1, 1))] == []
    assert sorted_by_port(rows_of(9, 1, 1, 1), {("dde-1", 1)})[1] == []


def test_pieces_of_many_ports_are_taken_together_in_their_order() -> None:
    pieces = [rows_of(6000, 3, 2, seed, coded=seed < 20) for seed in range(25)]
    together = [*gathered(iter(pieces), 6)]
    assert len(together) < 6
    assert all(len(piece) >= 6 * ROWS_OF_A_PORT for piece in together[:2])
    columns = ("port", "tick")
    for name in columns:
        assert [one for piece in together for one in piece[name].to_pylist()] == [
            one for piece in pieces for one in piece[name].to_pylist()
        ]
    assert [one for piece in together for one in piece["station"].cast("string").to_pylist()] == [
        one for piece in pieces for one in piece["station"].cast("string").to_pylist()
    ]
    assert [*gathered(iter(pieces), 1)] == pieces
