"""The page: one HTML file without links to other hosts, made from the facts by a template.

The template engine escapes all text; figures are images, in which no script can run; a content
security policy forbids every request and every script but two, named by their hashes: uPlot and the
interactive view. The page is complete without them.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from hashlib import sha256
from importlib.resources import files
from typing import Final
from urllib.parse import quote

from jinja2 import Environment
from markupsafe import Markup

from jbclog.analysis.figures.ticks import duration_text
from jbclog.analysis.verdict.rules import CONFIDENCE
from jbclog.report import joint_words
from jbclog.report.alarms import WITNESSES
from jbclog.report.joint_words import jointed, remark
from jbclog.report.page_template import environment
from jbclog.report.safety import short
from jbclog.report.text import bound_text, clock, interval, measured

PLAIN_IN_ADDRESS = " !$'()*+,-./:;=@_?[]{}|^~"
# a drawing is mostly digits, and `translate` would look up each character
RESERVED: Final = re.compile(f"[^{re.escape(PLAIN_IN_ADDRESS)}0-9A-Za-z]+")
MOST_QUOTED: Final = 1024
SIGNS = {
    "ACCEPT": ("accept", "✓"),
    "ACCEPT WITH DEVIATIONS": ("deviations", "△"),
    "REJECT": ("reject", "✕"),
    "INCONCLUSIVE": ("inconclusive", "?"),
    "NOT JUDGED": ("notjudged", "–"),
}
MOST_ALARMS, MOST_UNITS = 200, 200
UPLOT: Final = ("vendor", "uplot")
SCRIPTS: Final = ((*UPLOT, "uPlot.iife.min.js"), ("templates", "interactive.js"))
RESULT_SIGNS = {
    "pass": "✓",
    "fail": "✕",
    "missing": "?",
    "deviation": "△",
    "not applicable": "–",
    "none": "–",
}

ENDINGS = {
    "success": "complete",
    "aborted": "stopped before its stated end",
    "failed": "ended with an error",
    "lost": "cut off",
}


def render(
    document: Mapping[str, object], figures: Mapping[str, tuple[str, str]], zooms: Mapping[str, str]
) -> str:
    """Return the page of a report.

    `figures`: file name of a figure -> its wide and its narrow SVG; `zooms`: file name -> data of
    its interactive view.
    """
    uris = {file: tuple(map(cache(data_uri), pair)) for file, pair in figures.items()}
    # one size for all, as there are many
    crowded = sum(first == second for first, second in uris.values()) > 1
    page = _environment().get_template("report.html")
    return page.render(report=document, uris=uris, zooms=zooms, crowded=crowded, **_interactive())


@cache
def _interactive() -> dict[str, object]:
    """Return the input of the interactive view: uPlot with its style and licence, our script, and
    the hashes of both.
    """
    here = files("jbclog.report")
    scripts = [here.joinpath(*path).read_bytes().decode() for path in SCRIPTS]
    hashes = [base64.b64encode(sha256(script.encode()).digest()).decode() for script in scripts]
    source = json.loads(here.joinpath(*UPLOT, "source.json").read_text("utf-8"))
    plot_style, licence = (
        here.joinpath(*UPLOT, name).read_bytes().decode() for name in ("uPlot.min.css", "LICENSE")
    )
    return {
        "scripts": [Markup(script) for script in scripts],
        "script_sources": Markup(" ".join(f"'sha256-{one}'" for one in hashes)),
        "plot_name": f"{source['name']} {source['version']}",
        "plot_style": Markup(plot_style),
        "plot_licence": Markup(licence.strip()),
    }


def data_uri(svg: str) -> str:
    """Return an SVG document as a data URI; only characters reserved in URIs or attributes are
    escaped.
    """
    plain = " ".join(svg.split())
    return f"data:image/svg+xml,{RESERVED.sub(lambda found: _quoted(found[0]), plain)}"


@lru_cache(MOST_QUOTED)
def _quoted(text: str) -> str:
    return quote(text, safe=PLAIN_IN_ADDRESS)


@cache
def _environment() -> Environment:
    made = environment("jbclog.report")
    made.filters.update(
        measured=measured,
        clock=clock,
        duration=_duration,
        place=place,
        bound=bound_text,
        own=_own,
        interval=interval,
        jointed=jointed,
        remark=remark,
        found_with=joint_words.found_with,
        joint_count=joint_words.count,
        joint_heat=joint_words.heat,
        idle_error=joint_words.idle,
        verified=short,
    )
    made.globals.update(signs=SIGNS, result_signs=RESULT_SIGNS, endings=ENDINGS)
    made.globals.update(
        witnesses=WITNESSES,
        most_alarms=MOST_ALARMS,
        most_units=MOST_UNITS,
        joint_note=joint_words.NOTE,
        when_passed=when_passed,
    )
    return made


PASSES: Final = (
    "An estimated figure passes when the figure and its bound are within the limit; without a bound"
    " the result is not known."
)


def when_passed(rules: Sequence[Mapping[str, object]]) -> str:
    """Return when an estimated figure passes, and on which stations a recipe judges otherwise."""
    bare = list(
        dict.fromkeys(str(rule["station"]) for rule in rules if rule.get("name") == CONFIDENCE)
    )
    return (
        f"{PASSES} Except on {', '.join(bare)}: its recipe judges figures without bounds."
        if bare
        else PASSES
    )


def _duration(seconds: float | None) -> str:
    return "not known" if seconds is None else duration_text(seconds)


def _own(text: str, station: str) -> str:
    """Return the reason of a station without its name, as a sentence."""
    bare = text.removeprefix(f"{station}: ").rstrip(".")
    return f"{bare[:1].upper()}{bare[1:]}."


def place(row: Mapping[str, object]) -> str:
    """Return ``dde-1 · port 2``; empty for the run as a whole."""
    parts = [str(row["station"])] if row.get("station") is not None else []
    return " · ".join([*parts, f"port {row['port']}"] if row.get("port") is not None else parts)
