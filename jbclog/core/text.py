"""Text for people: on a page, in a table, in CSV."""

from __future__ import annotations

import csv
import io
import json
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

# -- text ---------------------------------------------------------------------------------------------------------------------

HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Control, formatting (bidi among them), unpaired surrogates, private, unassigned, and what ends a line or a paragraph."""
BLANKS = "\n\r\t\v\f\x85\u2028\u2029"  # they part words, and are shown as a space
INSTEAD = "\ufffd"


def clean(text: str) -> str:
    """One line of text from outside, disarmed, for every way out: terminal, log, CSV, HTML, PDF.

    What ends a line is a space, so that no text makes a line of its own; what else does not show is `INSTEAD`, so that nothing can
    move the cursor, turn the reading direction or hide a word, and two names that look alike are not the same by a sign in one.
    """
    if text.isprintable():
        return text
    return "".join(_shown(sign) for sign in text)


def _shown(sign: str) -> str:
    return " " if sign in BLANKS else INSTEAD if unicodedata.category(sign) in HIDDEN else sign


def json_line(data: object, *, only_ascii: bool = False) -> str:
    """`data` as JSON on one line, what `clean` would take out escaped: who reads the JSON gets it, and a terminal does not."""
    text = json.dumps(data, ensure_ascii=only_ascii, default=str)
    return text if text.isprintable() else "".join(_escaped(sign) for sign in text)


def _escaped(sign: str) -> str:
    return json.dumps(sign)[1:-1] if unicodedata.category(sign) in HIDDEN else sign


def cleaned(value: object) -> object:
    """The same structure with every text clean, keys as well."""
    if isinstance(value, str):
        return clean(value)
    if isinstance(value, Mapping):
        return {clean(str(key)): cleaned(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [cleaned(one) for one in value]
    return value


def stamp(text: str | None) -> str:
    """``2026-11-21 01:30:00``, from `iso`."""
    return "not known" if text is None else text[:19].replace("T", " ")


def number(value: object, digits: int = 2) -> str:
    """A number with a thin space between thousands and no zeros behind; nothing known is a dash, never zero."""
    if value is None:
        return "–"
    if not isinstance(value, int | float) or isinstance(value, bool):
        return str(value)
    text = f"{value:,.{digits}f}" if isinstance(value, float) else f"{value:,}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    text = "0" if text in ("-0", "") else text
    return text.replace(",", "\u202f").replace("-", "\u2212")


_UNITS = re.compile(r"(?<=\d) (?=(?:°C|%|‰|ms|s|min|h|Hz|mm|Wh)(?!\w))")


def together(text: str) -> str:
    """A sentence in which no number is parted from its unit at the end of a line."""
    return _UNITS.sub("\u00a0", text)


# -- csv ----------------------------------------------------------------------------------------------------------------------
# CSV as spreadsheets read it: RFC 4180, UTF-8 with the mark by which they know it, and no cell that they would work out.

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
