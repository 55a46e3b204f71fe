"""Letters as figures and sheets have them: how wide a text is, what stands for letters that our font lacks, the font's bytes."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from fontTools.subset import Options, Subsetter
from fontTools.ttLib import TTFont

from jbclog.errors import RecordError

FILES: Final = {False: "DejaVuSans.ttf", True: "DejaVuSans-Bold.ttf"}
"""They come with matplotlib, so a report is the same on every machine."""
LACKING: Final = "\u25af"
LACKING_MEANS: Final = f"{LACKING} stands for a letter that the font of this paper lacks; report.html and report.json have it."
NOT_PRINTED: Final = ("GSUB", "GPOS", "GDEF", "kern", "name", "OS/2", "post", "gasp", "FFTM", "cvt ", "fpgm", "prep")


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """One weight of our font; `box`, `ascent` and `descent` in the font's units."""

    path: Path
    units: int
    glyphs: Mapping[int, int]
    advances: Mapping[int, int]
    box: tuple[int, int, int, int]
    ascent: int
    descent: int

    def glyph(self, letter: str) -> int:
        """The number of its glyph."""
        return self.glyphs.get(ord(letter), 0)

    def advance(self, letter: str) -> float:
        """How wide it is, in thousandths of the font's size."""
        return 1000 * self.advances.get(ord(letter), 0) / self.units

    def scaled(self, units: int) -> int:
        """Units of the font in thousandths of its size."""
        return round(1000 * units / self.units)

    def width(self, text: str) -> float:
        """How wide a text is, in sizes of the font."""
        return sum(self.advances.get(ord(letter), 0) for letter in text) / self.units


@lru_cache(16)
def font_program(bold: bool, letters: frozenset[str]) -> bytes:
    """The font with nothing but these letters, each by the number that it had; kept, as many reports have the same letters."""
    options = Options(retain_gids=True, hinting=False, layout_features=[], notdef_outline=True, recalc_timestamp=False)
    options.drop_tables += NOT_PRINTED
    with TTFont(face(bold).path, lazy=True, recalcTimestamp=False) as font:
        subsetter = Subsetter(options)
        subsetter.populate(unicodes=sorted(map(ord, letters)))
        subsetter.subset(font)
        del font["cmap"]
        out = io.BytesIO()
        font.save(out, reorderTables=False)
    return out.getvalue()


@cache
def face(bold: bool) -> Face:
    """The weight, read once. Raises `RecordError` where matplotlib is not as it was installed."""
    path = _folder() / FILES[bold]
    try:
        with TTFont(path, lazy=True, recalcTimestamp=False) as font:
            names, widths, head = font.getBestCmap(), font["hmtx"].metrics, font["head"]
            glyphs = {code: font.getGlyphID(name) for code, name in names.items()}
            advances = {code: widths[name][0] for code, name in names.items()}
            box = (head.xMin, head.yMin, head.xMax, head.yMax)
            return Face(path, head.unitsPerEm, glyphs, advances, box, font["hhea"].ascent, font["hhea"].descent)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror}; the letters of a report come with matplotlib: install it again") from error


def _folder() -> Path:
    """Where matplotlib has its fonts, found without loading it."""
    found = find_spec("matplotlib")
    places = [] if found is None else list(found.submodule_search_locations or ())
    return Path(places[0] if places else "matplotlib") / "mpl-data" / "fonts" / "ttf"


def drawable(text: str, *, bold: bool = False) -> str:
    """The text with `LACKING` for each letter that cannot be drawn."""
    if text.isascii():
        return text
    known = face(bold).glyphs
    return "".join(letter if ord(letter) in known else LACKING for letter in text)


@cache
def width_in(text: str, points: float, bold: bool) -> float:
    """How wide a text is when it is drawn, in inches."""
    return face(bold).width(drawable(text, bold=bold)) * points / 72
