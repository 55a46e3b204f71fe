"""Letters as figures and sheets have them: how wide a text is, and what stands for letters that our font lacks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from fontTools.ttLib import TTFont

from jbclog.core.errors import RecordError

FILES: Final = {False: "DejaVuSans.ttf", True: "DejaVuSans-Bold.ttf"}
"""They come with matplotlib, so a report is the same on every machine."""
LACKING: Final = "\u25af"
LACKING_MEANS: Final = f"{LACKING} stands for a letter that the font of this paper lacks; report.html and report.json have it."


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """One weight of our font: its file, and how wide each letter is in its units."""

    path: Path
    units: int
    advances: Mapping[int, int]

    def width(self, text: str) -> float:
        """How wide a text is, in sizes of the font."""
        return sum(self.advances.get(ord(letter), 0) for letter in text) / self.units


@cache
def face(bold: bool) -> Face:
    """The weight, read once. Raises `RecordError` where matplotlib is not as it was installed."""
    path = _folder() / FILES[bold]
    try:
        with TTFont(path, lazy=True, recalcTimestamp=False) as font:
            widths = font["hmtx"].metrics
            advances = {code: widths[name][0] for code, name in font.getBestCmap().items()}
            return Face(path, font["head"].unitsPerEm, advances)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror}; the letters of a report come with matplotlib: install it again") from error


def _folder() -> Path:
    """Where matplotlib has its fonts, found without loading it."""
    found = find_spec("matplotlib")
    places = [] if found is None else list(found.submodule_search_locations or ())
    return Path(places[0] if places else "matplotlib") / "mpl-data" / "fonts" / "ttf"


def drawable(text: str, *, bold: bool = False) -> str:
    """The text with `LACKING` for each letter that cannot be drawn."""
    if text.isascii() and text.isprintable():
        return text
    known = face(bold).advances
    return "".join(letter if ord(letter) in known else LACKING for letter in text)


@cache
def width_in(text: str, points: float, bold: bool) -> float:
    """How wide a text is when it is drawn, in inches."""
    return face(bold).width(drawable(text, bold=bold)) * points / 72
