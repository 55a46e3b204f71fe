"""All metrics of one port, in the order of their definitions; each with its value, or with the reason why it has none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from jbclog.features.definitions import DEFINITIONS
from jbclog.features.energy import energy
from jbclog.features.figure import Figure, no_figure
from jbclog.features.heating import heating
from jbclog.features.idling import idling
from jbclog.features.joints import Found, find_joints
from jbclog.features.recovery import Dip, dips, recovery
from jbclog.features.series import Series
from jbclog.features.wire import Wire, wire_figures

NOT_OF: Final = {
    "omega": "An OMEGA tells neither temperature nor power, only its states.",
    "air": "Hot air: what it heats shows neither in its own temperature nor in its power.",
    "tip": "The tool has no feeder.",
}
"""Kind of tool -> why it lacks the metrics that are not its own."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The metrics of a port and the joints that some of them rest on."""

    figures: list[Figure]
    dips: list[Dip]


def measure_port(series: Series, kind: str, wire: Wire | None = None) -> Measured:
    """Every metric of a port whose tool is a ``tip``, hot ``air`` or an ``omega``."""
    if kind == "omega":
        return Measured([no_figure(one.name, one.unit, NOT_OF[kind]) for one in DEFINITIONS], [])
    found = find_joints(series) if kind == "tip" else Found([], [], 0.0, 0.0)
    seen = dips(series, found)
    figures = [*heating(series), *idling(series), *energy(series, found.joints if kind == "tip" else None)]
    if kind == "tip":
        figures += [*recovery(series, found, seen), *wire_figures(series, wire, found.joints)]
    return Measured(_in_order(figures, kind), seen)


def _in_order(figures: list[Figure], kind: str) -> list[Figure]:
    by_name = {figure.name: figure for figure in figures}
    return [by_name.get(one.name) or no_figure(one.name, one.unit, NOT_OF[kind]) for one in DEFINITIONS]
