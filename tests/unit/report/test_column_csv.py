"""A long table that is made column by column has the bytes of one that is made cell by cell."""

import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from jbclog.core.text import csv_text
from jbclog.report.column_csv import csv_lines
from jbclog.report.text import iso_times

CELLS = ["=1", "a,b", '"', "a\r\nb", "°C", "", "U-1", None]
NUMBERS = [0.0, -0.0, 350.0, 0.001, 1e-4, 9.9e-5, 1e9, 1e10, 1e16, 123456.789, None]
ROWS = st.tuples(
    st.one_of(st.sampled_from(CELLS), st.text()),
    st.one_of(
        st.sampled_from(NUMBERS),
        st.floats(allow_nan=False, allow_infinity=False),
        st.integers(-(10**9), 10**9).map(lambda thousandths: thousandths / 1000),
    ),
    st.one_of(st.integers(-(2**53), 2**53), st.none()),
    st.one_of(st.booleans(), st.none()),
    st.one_of(st.integers(0, 7_258_118_400_000_000), st.none()),  # to 2200
)
SCHEMA = pa.schema(
    [
        *(("text", pa.string()), ("float", pa.float64()), ("count", pa.int64())),
        *(("flag", pa.bool_()), ("time", pa.timestamp("us", tz="UTC"))),
    ]
)


@given(st.lists(ROWS, max_size=9), st.booleans())
def test_its_bytes_are_those_of_csv(rows: list[tuple[object, ...]], coded: bool) -> None:
    names = SCHEMA.names
    table = pa.table(
        [pa.array([row[place] for row in rows], field.type) for place, field in enumerate(SCHEMA)],
        schema=SCHEMA,
    )
    if coded:
        table = table.set_column(0, "text", table["text"].dictionary_encode())
    times = iso_times(pa.array([row[-1] for row in rows], pa.timestamp("us"))).to_pylist()
    rows = [(*row[:-1], time) for row, time in zip(rows, times, strict=True)]
    expected = csv_text(names, [dict(zip(names, row, strict=True)) for row in rows])
    assert csv_text(names, ()).encode() + csv_lines(table) == expected.encode()
    if len(rows) > 1:
        rest = csv_text(names, [dict(zip(names, row, strict=True)) for row in rows[1:]])
        assert csv_text(names, ()).encode() + csv_lines(table[1:]) == rest.encode()
