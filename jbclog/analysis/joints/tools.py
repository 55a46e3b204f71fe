"""The stretches of a port by tool: each exchange of the tool needs a new model, because another tip
has another heat balance.

The stretches between two exchanges are a tool of their own if they last at least `OWN_MODEL_S`;
shorter ones are merged by the tool's code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol, TypeVar

import numpy as np

from jbclog.analysis.joints.heat_up_end import ReadyStretch
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.thermal import ThermalModel
from jbclog.analysis.port_data import Floats

OWN_MODEL_S: Final = 60.0
UNKNOWN_CODE: Final = -1.0


@dataclass(frozen=True, slots=True)
class Tool:
    """The stretches of a tool and its model."""

    parts: Sequence[ReadyStretch]
    model: ThermalModel


def by_tool(series: Series, parts: Sequence[ReadyStretch]) -> list[list[ReadyStretch]]:
    """Return the stretches of each tool."""
    absent = np.concatenate(([0], np.cumsum(~series.rows.in_place)))
    codes = series.rows.tool
    groups: list[tuple[float, list[ReadyStretch]]] = []
    last: tuple[float, int] | None = None
    for part in parts:
        row = int(np.searchsorted(series.seconds, part.stretch.seconds[0] - 1e-6))
        code = code_at(codes, row)
        here = (code, int(absent[row]))
        if here != last:
            groups.append((code, []))
        groups[-1][1].append(part)
        last = here
    return merged_by_code(groups)


def code_at(codes: Floats | None, row: int) -> float:
    """Return the code of the tool that was last read up to this row."""
    if codes is None:
        return UNKNOWN_CODE
    known = np.flatnonzero(~np.isnan(codes[: row + 1]))
    return float(codes[known[-1]]) if len(known) else UNKNOWN_CODE


class Piece(Protocol):
    """A stretch, for its assignment to a tool."""

    @property
    def start_s(self) -> float: ...

    @property
    def length_s(self) -> float: ...


P = TypeVar("P", bound=Piece)


def merged_by_code(groups: Sequence[tuple[float, list[P]]]) -> list[list[P]]:
    """Return the stretches of each tool; `groups` are those between two exchanges, with the code of
    the tool.
    """
    own = [parts for _, parts in groups if _length_s(parts) >= OWN_MODEL_S]
    small: dict[float, list[P]] = {}
    for code, parts in groups:
        if _length_s(parts) < OWN_MODEL_S:
            small.setdefault(code, []).extend(parts)
    return sorted([*own, *small.values()], key=lambda parts: parts[0].start_s)


def _length_s(parts: Sequence[Piece]) -> float:
    return sum(part.length_s for part in parts)
