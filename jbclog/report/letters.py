"""Letters as figures and sheets have them: how wide a text is, and what stands for letters that our font lacks."""

from __future__ import annotations

from functools import cache
from typing import Final

from matplotlib.font_manager import FontProperties, findfont, get_font

FAMILY: Final = "DejaVu Sans"  # it comes with matplotlib, so a report is the same on every machine
LACKING: Final = "\u25af"
LACKING_MEANS: Final = f"{LACKING} stands for a letter that the font of this paper lacks; report.html and report.json have it."


@cache
def _font(bold: bool) -> str:
    return findfont(FontProperties(family=[FAMILY], weight="bold" if bold else "normal"))


@cache
def _known(bold: bool) -> frozenset[int]:
    return frozenset(get_font(_font(bold)).get_charmap())


def drawable(text: str, *, bold: bool = False) -> str:
    """The text with `LACKING` for each letter that cannot be drawn."""
    if text.isascii():
        return text
    known = _known(bold)
    return "".join(letter if ord(letter) in known else LACKING for letter in text)


@cache
def width_in(text: str, points: float, bold: bool) -> float:
    """How wide a text is when it is drawn, in inches."""
    font = get_font(_font(bold))
    font.set_size(points, 72)
    font.set_text(drawable(text, bold=bold), 0.0)
    return float(font.get_width_height()[0]) / 64 / 72
