"""Text for people: terminal, page, table, CSV, warnings of Python."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import unicodedata
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories of invisible characters: control, formatting (bidi included), surrogate,
private, unassigned, line separators.
"""
BLANKS = "\n\r\t\v\f\x85\u2028\u2029"  # shown as a space
REPLACEMENT = "\ufffd"


def clean(text: str) -> str:
    """Make untrusted text safe for every output (terminal, log, CSV, HTML, PDF): one line without
    invisible characters.

    Replaces line ends by a space and other invisible characters by `REPLACEMENT`, so that nothing
    moves the cursor, changes the reading direction or hides a word, and no two names differ only by
    an invisible character.
    """
    if text.isprintable():
        return text
    return "".join(_shown(sign) for sign in text)


def _shown(sign: str) -> str:
    return " " if sign in BLANKS else REPLACEMENT if unicodedata.category(sign) in HIDDEN else sign


def shortened(text: str, most: int) -> str:
    """Shorten to `most` characters, noting how many were left out."""
    return (
        text
        if len(text) <= most
        else f"{text[:most]}… ({len(text) - most} characters are left out)"
    )


def warn(text: str) -> None:
    """Warn whoever called the method that calls this. Python prints a warning as it is, and the
    name of a folder can be any text.
    """
    warnings.warn(clean(text), stacklevel=3)


def json_line(data: object, *, only_ascii: bool = False) -> str:
    """Format `data` as one line of JSON with invisible characters escaped."""
    text = json.dumps(data, ensure_ascii=only_ascii, default=str)
    return text if text.isprintable() else "".join(_escaped(sign) for sign in text)


def _escaped(sign: str) -> str:
    return json.dumps(sign)[1:-1] if unicodedata.category(sign) in HIDDEN else sign


def cleaned(value: object) -> object:
    """Apply `clean` to every text in a structure, keys included."""
    if isinstance(value, str):
        return clean(value)
    if isinstance(value, Mapping):
        return {clean(str(key)): cleaned(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [cleaned(one) for one in value]
    return value


def count_text(count: int, noun: str) -> str:
    """Format a count: ``1 run``, ``3 runs``."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def stamp(text: str | None) -> str:
    """Format an ISO time as ``2026-11-21 01:30:00``."""
    return "not known" if text is None else text[:19].replace("T", " ")


def number(value: object, digits: int = 2) -> str:
    """Format with thin spaces between thousands, no trailing zeros; None is a dash, never zero."""
    if value is None:
        return "–"
    if not isinstance(value, int | float) or isinstance(value, bool):
        return str(value)
    text = f"{value:,.{digits}f}" if isinstance(value, float) else f"{value:,}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    text = "0" if text in ("-0", "") else text
    return text.replace(",", "\u202f").replace("-", "\u2212")


MOST_UNITS: Final = 3


def units_text(units: Sequence[str]) -> str:
    """Format serials: ``unit U-1``, ``units U-1, U-2``, ``units U-1, U-2, U-3 and 5 more``; empty
    for none.
    """
    if len(units) < 2:
        return "".join(f"unit {unit}" for unit in units)
    more = len(units) - MOST_UNITS
    return f"units {', '.join(units[:MOST_UNITS])}" + (f" and {more} more" if more > 0 else "")


DIGITS: Final = 12  # significant digits of a number in JSON


def exact(value: float, size: float | None = None) -> float:
    """Remove rounding noise of floats: 0.1 + 0.2 becomes 0.3.

    Keeps 12 digits; those of `size` if `value` is a difference or mean of values that large.
    """
    size = abs(value if size is None else size)
    return (
        round(value, DIGITS - 1 - math.floor(math.log10(size)))
        if math.isfinite(value) and 0 < size < math.inf
        else value
    )


def exact_figures(value: object) -> object:
    """Apply `exact` to each float in JSON data."""
    if isinstance(value, float):
        return exact(float(value))
    if isinstance(value, Mapping):
        return {key: exact_figures(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [exact_figures(one) for one in value]
    return value


_UNITS = re.compile(r"(?<=\d) (?=(?:°C|%|‰|ms|s|min|h|Hz|mm|Wh)(?!\w))")


def together(text: str) -> str:
    """Join numbers and units by no-break spaces."""
    return _UNITS.sub("\u00a0", text)


# Names of files: what jbclog writes can be copied to any file system.

_DEVICE: Final = re.compile(r"(?:con|prn|aux|nul|com[0-9]|lpt[0-9])(?=\.|$)", re.IGNORECASE)
_NOT_IN_NAMES: Final = re.compile(r'[<>:"/\\|?*\x00-\x1f]')


def is_device_name(name: str) -> bool:
    """Return whether Windows takes a name for that of a device, with or without an ending."""
    return _DEVICE.match(name) is not None


def file_name(name: str) -> str:
    """Return a name as every file system allows it: an underscore for each sign that Windows does
    not allow, and after the name of a device.
    """
    allowed = _NOT_IN_NAMES.sub("_", name)
    if allowed.endswith((".", " ")):
        allowed += "_"
    device = _DEVICE.match(allowed)
    if device is None:
        return allowed
    return f"{device[0]}_{allowed[device.end() :]}"


# CSV for spreadsheets: RFC 4180, UTF-8 with byte order mark, no cell that is evaluated as a
# formula.
FORMULA: Final = ("=", "+", "-", "@", "\t", "\r", "\uff1d", "\uff0b", "\uff0d", "\uff20")
BOM: Final = "\ufeff"


def csv_cell(value: object) -> object:
    """Return a cell as one line that no spreadsheet evaluates. Numbers stay numbers."""
    if not isinstance(value, str):
        return value
    text = clean(value)
    return (
        f"'{text}"
        if value.lstrip(" ").startswith(FORMULA) or text.lstrip(" ").startswith(FORMULA)
        else text
    )


def csv_text(columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> str:
    """Format a table with a header; an unknown value is an empty cell."""
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow([csv_cell(column) for column in columns])
    writer.writerows([csv_cell(row.get(column)) for column in columns] for row in rows)
    return BOM + out.getvalue()
