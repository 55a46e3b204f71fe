"""Texts made to do something where they are only to be shown: one table for every place that takes
a text from outside.
"""

from __future__ import annotations

import re
from html.parser import HTMLParser
from importlib.resources import files

from jbclog.report import page

SCRIPTS = [files("jbclog.report").joinpath(*path).read_bytes().decode() for path in page.SCRIPTS]

HOSTILE = {
    "parent folder": "../../../etc/passwd",
    "parent": "..",
    "here": ".",
    "absolute": "/etc/passwd",
    "windows parent": "..\\..\\x",
    "share": "\\\\host\\share",
    "device name": "CON",
    "alternate stream": "a.txt:b",
    "line end": "a\nb",
    "windows line end": "a\r\nerror: b",
    "return": "ACCEPT\rREJECT",
    "backspaces": "REJECT\b\b\b\b\b\bACCEPT",
    "colour": "\x1b[31mred\x1b[2J",
    "title of the window": "\x1b]0;owned\x07",
    "link": "\x1b]8;;http://x.invalid\x1b\\x\x1b]8;;\x1b\\",
    "clipboard": "\x1b]52;c;eA==\x07",
    "one-byte escape": "\x9b31mred",
    "bidi": "\u202etxt.exe",
    "isolate": "\u2066a\u2069",
    "NUL": "a\0b",
    "delete": "a\x7fb",
    "hidden": "dde\u200b-1",
    "byte order": "\ufeffdde-1",
    "line of its own": "a\u2028b",
    "long": "x" * 5000,
    "dash": "-rf",
    "formula": "=cmd|' /C calc'!A0",
    "sum": "@SUM(1+1)*cmd|' /C calc'!A0",
    "plus": "+1+1",
    "script": "<script>document.title='owned'</script>",
    "attribute": '"><img src=x onerror="document.title=\'owned\'">',
    "single attribute": "'><svg/onload=document.title='owned'>",
    "end of style": "</style></title><b>",
    "end of data": "]]><x>",
    "address": "javascript:document.title='owned'",
    "template": "{{ 7 * 7 }}{% raw %}",
    "formula of a figure": "$\\frac{1}{0}$",
    "markup": "[red]x[/red][link=http://x.invalid]y[/link][/]",
    "format": "%s%n{0}{self}",
    "shell": "$(touch owned);`touch owned`",
    "homoglyph": "\u0501\u0501\u0435-1",
    "other dash": "dde\u20101",
    "combining": "a" + "\u0301" * 40,
    "blank": " ",
    "nothing": "",
}

ALLOWED_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}")
MOVES = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff]"
)
"""Characters that move a cursor, turn the reading direction, hide or begin an escape; a line's end
apart.
"""


def steers(text: str) -> list[str]:
    """What in `text` would steer a terminal."""
    return sorted({ascii(sign) for sign in MOVES.findall(text)})


# files that a report writes beside its page
BESIDE = ("tables/joints.csv", "tables/metrics.csv", "derived/joints.parquet")


class Acting(HTMLParser):
    """Collects what in a page could act: elements that load or run, handlers, addresses that are
    not of the page itself.
    """

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.found: list[str] = []
        self._elements: list[str] = []
        self.feed(html)
        for script in SCRIPTS:
            if "<script>" in self._elements and html.count(f"<script>{script}</script>") == 1:
                # the report's own, which its policy names by hash
                self._elements.remove("<script>")
        self.found += self._elements

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in (
            "script",
            "iframe",
            "object",
            "embed",
            "link",
            "form",
            "base",
            "svg",
            "math",
            "template",
        ):
            self._elements.append(f"<{tag}>")
        for name, value in attrs:
            if name.startswith("on") or (
                name == "href" and not str(value).startswith("#") and value not in BESIDE
            ):
                self.found.append(f"{tag} {name}={value}")
            if name in ("src", "srcset") and not str(value).startswith("data:image/"):
                self.found.append(f"{tag} {name}={value}")
