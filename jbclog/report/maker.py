"""Maker of a report: the versions of jbclog, its rules, the typesetter, and the drawing library. A
report can claim any.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from typing import Any, Final

from jbclog import __version__
from jbclog.analysis.verdict import RULES

FIRST: Final = (0, 1, 0)
"""The first release; an earlier version made no report."""
_VERSION: Final = re.compile(r"(\d{1,6})\.(\d{1,6})\.(\d{1,6})([-.+a-z][-.+a-z0-9]{0,30})?")


def tools() -> dict[str, str]:
    """Return what sets the paper and draws the figures, by its key in `report.json`: other versions
    may give other bytes.
    """
    return {
        "paper_by": f"typst {metadata.version('typst')}",
        "drawn_by": f"matplotlib {metadata.version('matplotlib')}",
    }


@dataclass(frozen=True, slots=True)
class Maker:
    """Maker that a report claims; `rules` is 1 for the first release, which named none."""

    version: object
    rules: object
    tools: Mapping[str, object]

    @property
    def is_this(self) -> bool:
        return self.has_these_words and dict(self.tools) == tools()

    @property
    def has_these_words(self) -> bool:
        """Whether this jbclog writes the same facts and sentences."""
        return (self.version, self.rules) == (__version__, RULES)

    def __str__(self) -> str:
        named = [f"{tool!s:.20}" for tool in self.tools.values() if tool is not None]
        return ", ".join([f"jbclog {self.version!s:.20} with rules {self.rules!s:.10}", *named])


def maker_of(report: Mapping[str, Any]) -> Maker | None:
    """Return the maker that the report claims, or None."""
    if "jbclog" not in report:
        return None
    return Maker(
        report["jbclog"], report.get("rules", 1), {key: report.get(key) for key in tools()}
    )


def impossible(maker: Maker) -> Iterator[str]:
    """Yield why no jbclog can be this maker."""
    version = _numbers(maker.version)
    if version is None:
        yield f"names jbclog {maker.version!s:.20} as its maker; that is no version"
    elif version < FIRST:
        yield (
            f"names jbclog {maker.version} as its maker; there was none before"
            f" {'.'.join(map(str, FIRST))}"
        )
    if not isinstance(maker.rules, int) or isinstance(maker.rules, bool) or maker.rules < 1:
        yield f"names rules {maker.rules!s:.20}; there are none"
    elif version is not None and version < (_numbers(__version__) or FIRST) and maker.rules > RULES:
        yield (
            f"names jbclog {maker.version} with rules {maker.rules}; this jbclog, {__version__},"
            f" knows rules 1 to {RULES}"
        )


def newer(maker: Maker) -> Iterator[str]:
    """Yield in what the maker is later than this jbclog."""
    version, own = _numbers(maker.version), _numbers(__version__)
    if version is not None and own is not None and version > own:
        yield f"newer than this one, {__version__}"
    if isinstance(maker.rules, int) and maker.rules > RULES:
        yield f"whose rules are not known here (1 to {RULES} are)"


def _numbers(version: object) -> tuple[int, ...] | None:
    """Return the three numbers of a version; None if it is not a version."""
    found = _VERSION.fullmatch(version) if isinstance(version, str) else None
    return None if found is None else tuple(map(int, found.group(1, 2, 3)))
