"""Check the values of untrusted Arrow tables: pyarrow does not."""

from __future__ import annotations

from typing import Final

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.files import NotReadable
from jbclog.core.json_files import FIRST_S, LAST_S
from jbclog.core.quantities import LARGEST

EXACT: Final = 1 << 53  # whole numbers up to here are floats, too: pyarrow converts no others
A_SECOND: Final = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}


def expect_values(rows: pa.Table | pa.RecordBatch, where: str) -> None:
    """Check that texts are UTF-8, numbers finite and in range, times between 1970 and 2200.

    `where` begins the message. Raises `NotReadable` or pa.ArrowException.
    """
    rows.validate(full=True)
    for name, column in zip(rows.schema.names, rows.columns, strict=True):
        if column.null_count == len(column):
            continue  # most columns of most samples: a live store has thousands of small batches
        if pa.types.is_floating(column.type):
            least, most = -LARGEST, LARGEST
            if pc.all(pc.is_finite(column)).as_py() is False:
                raise NotReadable(f"{where}{name} has a value that is not a number")
        elif pa.types.is_timestamp(column.type):
            a_second = A_SECOND[column.type.unit]
            column = column.cast(pa.int64())
            least, most = FIRST_S * a_second, LAST_S * a_second
        elif pa.types.is_integer(column.type):
            least, most = -EXACT, EXACT
        else:
            continue
        found = pc.min_max(column).as_py()
        if found["min"] is not None and not least <= found["min"] <= found["max"] <= most:
            raise NotReadable(f"{where}{name} has a value out of range")
