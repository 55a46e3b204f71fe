"""Text from outside and numbers, made fit to be shown."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from datetime import UTC, datetime
from math import floor

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


def iso(moment: datetime | None) -> str | None:
    """``2026-11-21T01:30:00.123456Z``."""
    return None if moment is None else moment.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def stamp(text: str | None) -> str:
    """``2026-11-21 01:30:00``, from `iso`."""
    return "not known" if text is None else text[:19].replace("T", " ")


def clock(text: str | None, *, with_day: bool = False) -> str:
    """``01:30:00.123``, from `iso`; with the day ``11-21 01:30:00.123``."""
    if text is None:
        return ""
    return f"{text[5:10]} {text[11:23]}" if with_day else text[11:23]


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


def measured(value: object, unit: str) -> str:
    """A figure with its unit. Per cent are never rounded up: 99.996 % of the readings are not all of them."""
    if isinstance(value, float) and unit == "%":
        value = floor(value * 100 + 1e-9) / 100
    return number(value) if value is None or not unit else f"{number(value)} {unit}"


def bound_text(bound: object, unit: str) -> str:
    """A rule's 95 % bound: ``−0.1 to 0.5 °C``, ``up to 0.9 °C``; a dash where there is none."""
    if not isinstance(bound, Mapping) or not isinstance(bound.get("high"), int | float):
        return "–"
    low, high = bound.get("low"), round(float(bound["high"]), 2)
    return (
        f"up to {measured(high, unit)}"
        if not isinstance(low, int | float)
        else f"{number(round(float(low), 2))} to {measured(high, unit)}"
    )


_UNITS = re.compile(r"(?<=\d) (?=(?:°C|%|‰|ms|s|min|h|Hz|mm|Wh)(?!\w))")


def together(text: str) -> str:
    """A sentence in which no number is parted from its unit at the end of a line."""
    return _UNITS.sub("\u00a0", text)
