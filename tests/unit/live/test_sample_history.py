"""What is known of a port does not depend on the pieces in which its rows come, nor on their
order.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from jbclog.core.rows import COLUMN, SAMPLE_COLUMNS
from jbclog.live.sample_history import SampleHistory
from jbclog.record.row_batches import BARE, decode, encode

TICKS = 150  # at 1 Hz: more than a trace, and several means
PERIODS = {"dde-1": 1.0}


def rows_of(tick: int, port: int, temperature: int | None) -> list[object]:
    row: list[object] = [None] * len(SAMPLE_COLUMNS)
    values = {"time": tick * 1_000_000, "tick": tick, "station": "dde-1", "port": port}
    values |= {"quality": "ok", "temperature_c": temperature, "power_permille": tick}
    if temperature is None:
        values |= {"quality": "timeout", "reasons": "temperature_c=timeout"}
    for name, value in values.items():
        row[COLUMN[name]] = value
    return row


def known(pieces: Sequence[pa.Table]) -> list[object]:
    history = SampleHistory()
    for piece in pieces:
        history.add(piece, PERIODS)
    return [
        (
            key,
            port.newest,
            sorted(port.values.items()),
            sorted(port.failures.items()),
            (port.obtained, port.missing),
            port.points.trace(),
            port.means.trace(),
        )
        for key, port in sorted(history.ports.items())
    ]


@given(
    st.lists(st.none() | st.integers(20, 450), min_size=TICKS, max_size=TICKS),
    st.sets(st.integers(1, 2 * TICKS - 1), max_size=8),
    st.data(),
)
def test_pieces_in_any_order_give_the_same(
    temperatures: list[int | None], cuts: set[int], data: st.DataObject
) -> None:
    values = [
        value
        for tick, temperature in enumerate(temperatures)
        for port in (1, 2)
        for value in rows_of(tick, port, temperature)
    ]
    rows = decode(encode("samples", values, 0, breath=lambda: None), BARE["samples"], "run")
    edges = [0, *sorted(cuts), len(rows)]
    pieces = [rows.slice(a, b - a) for a, b in pairwise(edges)]
    assert known(data.draw(st.permutations(pieces))) == known([rows])
