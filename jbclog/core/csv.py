"""CSV as spreadsheets read it: RFC 4180, UTF-8 with the mark by which they know it, and no cell that they would work out."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from jbclog.core.text import clean

FORMULA: Final = ("=", "+", "-", "@", "\t", "\r", "\uff1d", "\uff0b", "\uff0d", "\uff20")
MARK: Final = "\ufeff"


def harmless(value: object) -> object:
    """What a cell holds: one line, and never something that a spreadsheet would work out. Numbers stay numbers."""
    if not isinstance(value, str):
        return value
    text = clean(value)
    return f"'{text}" if value.lstrip(" ").startswith(FORMULA) or text.lstrip(" ").startswith(FORMULA) else text


def csv_text(columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> str:
    """A table with its head; nothing stands where nothing is known."""
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow([harmless(column) for column in columns])
    writer.writerows([harmless(row.get(column)) for column in columns] for row in rows)
    return MARK + out.getvalue()
