"""Say in words why a line is not TOML, where editors, spreadsheets and habits left their marks:
typographic quotes, unusual spaces, decimal commas, lone CRs. Start with `advice`.
"""

from __future__ import annotations

import re
import unicodedata
from typing import Final

# what TOML itself leaves free: strings and comments of a line
_FREE: Final = re.compile(r""""(?:[^"\\]|\\.)*"|'[^']*'|\#.*""")

_SINGLE_QUOTES: Final = "‘’‚‛′`´"
_DOUBLE_QUOTES: Final = "“”„‟″«»"
_DASHES: Final = "‐‑‒–—−"
_NAMES: Final = {"\t": "tab", "\ufeff": "byte order mark"}

_LONE_CR: Final = re.compile(r"\r(?!\n)")
_NUMBER: Final = r"(?P<whole>[+-]?\d{1,3}(?:\.\d{3})+|[+-]?\d+),(?P<rest>\d+)"
_DECIMAL_COMMA: Final = re.compile(rf"=[ \t]*(?P<number>{_NUMBER})(?![\d,])")
_TAB_IN_TIME: Final = re.compile(r"\d{4}-\d\d-\d\d(?P<tab>\t+)\d\d:")
_DOTTED_DATE: Final = re.compile(r"(?<![\d.])(?P<date>(\d\d?)\.(\d\d?)\.(\d{4}))(?![\d.])")


def advice(text: str, line: int) -> str | None:
    """Return what is wrong in a line that is not TOML, and how to write it; None if it is something
    else. `line`: its number, from 1, where a line ends with LF.
    """
    lines = text.split("\n")
    if not 1 <= line <= len(lines):
        return None
    found = _advice_on(lines[line - 1])
    if found is None:
        return None
    kind, sentence = found
    others = [_advice_on(other) for other in lines[line:]]
    more = sum(1 for other in others if other is not None and other[0] == kind)
    if not more:
        return sentence
    return f"{sentence} (also in {more} more {'line' if more == 1 else 'lines'})"


def _advice_on(line: str) -> tuple[str, str] | None:
    """Return the kind of a mistake, and the sentence about it."""
    lone = _LONE_CR.search(line.removesuffix("\r"))
    if lone is not None:
        return "CR", "its lines end with CR alone; save it with LF or CR LF as line ends"
    bare = _FREE.sub(lambda match: " " * len(match[0]), line)
    return _about_character(bare) or _about_number(bare)


def _about_character(bare: str) -> tuple[str, str] | None:
    for column, sign in enumerate(bare, 1):
        if sign.isascii() and sign not in _SINGLE_QUOTES and (sign.isprintable() or sign in "\t\r"):
            continue
        kind, words, remedy = _described(sign)
        return kind, f"{words} at column {column}; {remedy}"
    return None


def hidden_words(sign: str) -> str:
    """Return the name of a character that does not show, with its number."""
    name = _NAMES.get(sign) or unicodedata.name(sign, "control character").lower()
    return f"{name} (U+{ord(sign):04X})"


def _described(sign: str) -> tuple[str, str, str]:
    """Return the kind of a character, the character in words, and the remedy."""
    if sign in _DOUBLE_QUOTES:
        return "quote", f"typographic quote {sign}", 'use a straight quote, "'
    if sign in _SINGLE_QUOTES:
        return "quote", f"typographic quote {sign}", "use a straight quote, ' or \""
    category = unicodedata.category(sign)
    if category == "Zs":
        return "space", hidden_words(sign), "use an ordinary space"
    if category[0] in "CZ":
        return "hidden", hidden_words(sign), "remove it"
    name = f"{unicodedata.name(sign, 'character').lower()} {sign}"
    if sign in _DASHES:
        return "dash", name, "use a plain minus, -"
    plain = unicodedata.normalize("NFKC", sign)
    if len(plain) == 1 and plain.isascii():
        return "wide", name, f"use {plain}"
    if category[0] == "L":
        return "letter", f"letter {sign}", "it is allowed in quotes only"
    return "sign", name, "write a number alone, a text in quotes"


def _about_number(bare: str) -> tuple[str, str] | None:
    comma = _DECIMAL_COMMA.search(bare)
    if comma is not None:
        plain = f"{comma['whole'].replace('.', '')}.{comma['rest']}"
        return "comma", f"decimal comma; write {plain}, not {comma['number']}"
    tab = _TAB_IN_TIME.search(bare)
    if tab is not None:
        column = tab.start("tab") + 1
        return "tab", f"tab between date and time at column {column}; use a space or T"
    dotted = _DOTTED_DATE.search(bare)
    if dotted is not None:
        _, day, month, year = dotted.groups()
        return "date", f"date; write {year}-{month:0>2}-{day:0>2}, not {dotted['date']}"
    return None
