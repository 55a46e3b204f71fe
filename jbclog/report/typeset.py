"""Sets `report.pdf` with typst: `templates/report.typ` has the layout, the content comes as JSON.

Foreign text stays data: the template never evaluates it. Only the fonts in the package are used, so
the same data give the same bytes on every machine. PDF/A-2a: tagged, with all fonts embedded, for
archives.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping
from datetime import datetime
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final
from unicodedata import category, normalize

import typst

from jbclog.core.errors import RecordError
from jbclog.core.text import HIDDEN

PROFILE: Final = "a-2a"
FONTS: Final = ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf")
LACKING: Final = "\u25af"
LACKING_MEANS: Final = (
    f"{LACKING} stands for a letter that the font of this paper lacks; report.html and report.json"
    " have it."
)
# combining marks after a letter; the typesetter takes 2 GB for a thousand, 20 GB for four thousand
MARKS: Final = 16
UNUSUAL: Final = re.compile(r"[^\n -~]")  # the fonts have all letters but these
FULL_UNICODE: Final = (3, 10)  # platform and encoding of a font's table of 32-bit characters


def pdf_of(data: Mapping[str, object], dated: datetime) -> bytes:
    """Return the document that the template makes of `data`. Raises `RecordError`."""
    inputs = {"data": json.dumps(data, ensure_ascii=False)}
    compiler = typst.Compiler(_template(), str(_home()), _fonts(), sys_inputs=inputs)
    try:
        made = compiler.compile(
            format="pdf", pdf_standards=PROFILE, timestamp=round(dated.timestamp())
        )
    except typst.TypstError as error:
        raise RecordError(f"report.pdf cannot be made: {error.message}") from error
    assert isinstance(made, bytes)
    return made


@cache
def drawable(text: str) -> str:
    """Return the text with `LACKING` for each letter that the fonts lack, and for all combining
    marks of a letter with more than `MARKS`.
    """
    if text.isascii() and text.isprintable():
        return text
    used = frozenset(UNUSUAL.findall(text))
    lacking = dict.fromkeys(map(ord, used - _letters()), LACKING)
    # a figure's drawing is long, and `translate` would look up each character
    shown = text.translate(lacking) if lacking else text
    return _marks(MARKS + 1).sub(LACKING, shown) if used & _combining() else shown


def drawable_in_figure(svg: str) -> str:
    """Return the drawing with `LACKING` for characters that cannot be set in it, including a
    combining mark that does not compose with the letter before it.
    """
    return _marks(1).sub(LACKING, drawable(normalize("NFC", svg)))


def _home() -> Path:
    return Path(str(files("jbclog.report") / "vendor" / "dejavu"))


@cache
def _template() -> bytes:
    return (files("jbclog.report") / "templates" / "report.typ").read_bytes()


@cache
def _fonts() -> typst.Fonts:
    return typst.Fonts(
        include_system_fonts=False, include_embedded_fonts=False, font_paths=[str(_home())]
    )


@cache
def _letters() -> frozenset[str]:
    """Return the letters of both weights, and the line break, which the SVG of a figure has."""
    regular, bold = (_in_font(_home() / name) for name in FONTS)
    return (regular & bold) | {"\n"}


@cache
def _marks(least: int) -> re.Pattern[str]:
    """Return a pattern of `least` or more combining marks in succession."""
    marks = "".join(sorted(_combining()))
    return re.compile(f"[{re.escape(marks)}]{{{least},}}")


@cache
def _combining() -> frozenset[str]:
    """Return the combining marks among the letters."""
    return frozenset(one for one in _letters() if category(one).startswith("M"))


def _in_font(path: Path) -> frozenset[str]:
    """Return the letters of a font that `clean` lets pass, by its table of 32-bit characters
    (OpenType: cmap, format 12).
    """
    data = path.read_bytes()
    tables = {
        data[at : at + 4]: struct.unpack_from(">I", data, at + 8)[0]
        for at in range(12, 12 + 16 * data[5], 16)
    }
    cmap = tables[b"cmap"]
    kinds = (
        struct.unpack_from(">HHI", data, cmap + 4 + 8 * number) for number in range(data[cmap + 3])
    )
    (place,) = (cmap + offset for *kind, offset in kinds if tuple(kind) == FULL_UNICODE)
    (groups,) = struct.unpack_from(">I", data, place + 12)
    spans = (struct.unpack_from(">II", data, place + 16 + 12 * number) for number in range(groups))
    letters = frozenset(chr(code) for first, last in spans for code in range(first, last + 1))
    return frozenset(letter for letter in letters if category(letter) not in HIDDEN)
