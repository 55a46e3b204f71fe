"""The stretches of a port by tool: each exchange of the tool begins anew, since another tip has another heat balance.

What lies between two exchanges is a tool of its own where it is at least `OWN_MODEL_S` long; shorter ones are put together by
the tool's code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol, TypeVar

import numpy as np

from jbclog.analysis.joints.heat_up_end import Readied
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.thermal import ThermalModel
from jbclog.analysis.verdict.idle import Floats

OWN_MODEL_S: Final = 60.0
UNKNOWN_CODE: Final = -1.0


@dataclass(frozen=True, slots=True)
class Tool:
    """The stretches of a tool and its model."""

    parts: Sequence[Readied]
    model: ThermalModel


def by_tool(series: Series, parts: Sequence[Readied]) -> list[list[Readied]]:
    """The stretches of each tool: between two exchanges, those that are long enough for a model of their own."""
    absent = np.concatenate(([0], np.cumsum(~series.rows.in_place)))
    codes = series.rows.tool
    groups: list[tuple[float, list[Readied]]] = []
    last: tuple[float, int] | None = None
    for part in parts:
        row = int(np.searchsorted(series.seconds, part.stretch.seconds[0] - 1e-6))
        code = code_at(codes, row)
        here = (code, int(absent[row]))
        if here != last:
            groups.append((code, []))
        groups[-1][1].append(part)
        last = here
    return large_enough(groups)


def code_at(codes: Floats | None, row: int) -> float:
    """The tool's code that was last read."""
    if codes is None:
        return UNKNOWN_CODE
    known = np.flatnonzero(~np.isnan(codes[: row + 1]))
    return float(codes[known[-1]]) if len(known) else UNKNOWN_CODE


class Piece(Protocol):
    """A stretch, as far as it is put to a tool."""

    @property
    def start_s(self) -> float: ...

    @property
    def length_s(self) -> float: ...


P = TypeVar("P", bound=Piece)


def large_enough(groups: Sequence[tuple[float, list[P]]]) -> list[list[P]]:
    """The stretches of each tool; `groups` are those between two exchanges, with the tool's code."""
    own = [parts for _, parts in groups if _length_s(parts) >= OWN_MODEL_S]
    small: dict[float, list[P]] = {}
    for code, parts in groups:
        if _length_s(parts) < OWN_MODEL_S:
            small.setdefault(code, []).extend(parts)
    return sorted([*own, *small.values()], key=lambda parts: parts[0].start_s)


def _length_s(parts: Sequence[Piece]) -> float:
    return sum(part.length_s for part in parts)
