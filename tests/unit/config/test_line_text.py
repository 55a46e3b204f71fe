"""Line files that are written are read again as the same stations."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from jbclog.config.line import StationTable, line_text, parse_line
from jbclog.core.serial_line import BAUDRATES

ANY_TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=60)
URLS = st.one_of(
    st.text(st.characters(categories=["L", "N", "S", "Zs"]), min_size=1, max_size=30).map(
        lambda text: f"/dev/{text}"
    ),
    st.integers(1, 65535).map("socket://host:{}".format),
)


@given(
    ANY_TEXT,
    ANY_TEXT,
    URLS,
    st.sampled_from(BAUDRATES),
    st.sampled_from([False, 1, 99]),
    st.floats(0, 5000),
)
def test_whatever_is_said_in_comments(
    heading: str, said: str, url: str, rate: int, address: object, turnaround: float
) -> None:
    table = StationTable.model_validate(
        {
            "name": "s-1",
            "url": url,
            "family": "dde",
            "baudrate": rate,
            "format": "8O2",
            "address": address,
            "ports": [2],
            "turnaround_ms": turnaround,
            "rated_power_w": 130.5,
        }
    )
    line = parse_line(line_text("bench", [(table, said)], heading), Path("/x/line.toml"))
    (found,) = line.stations
    assert line.name == "bench"
    assert {name: getattr(found, name) for name in StationTable.model_fields} == table.model_dump()
