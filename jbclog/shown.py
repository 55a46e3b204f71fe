"""Text from outside and numbers, made fit to be shown on a page, whichever page it is."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping

NOT_SHOWN = ("Cc", "Cf", "Cs", "Co", "Cn")  # control, formatting (bidi among them), surrogates, private, unassigned


def clean(text: str) -> str:
    """Without control and formatting characters: none can move the cursor, turn the reading direction or hide a word."""
    if text.isascii() and text.isprintable():
        return text
    spaced = (" " if character in "\n\r\t\u2028\u2029" else character for character in text)
    return "".join(character for character in spaced if unicodedata.category(character) not in NOT_SHOWN)


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
