"""All metrics of one port, in the order of their definitions; each with its value, or with the reason why it has none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from jbclog.analysis.joints.figure import Figure, no_figure
from jbclog.analysis.joints.joints import Found, find_joints
from jbclog.analysis.joints.parameters import Asked
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.solder_wire import Wire, wire_figures
from jbclog.analysis.metrics.definitions import DEFINITIONS
from jbclog.analysis.metrics.energy import energy
from jbclog.analysis.metrics.heating import heating
from jbclog.analysis.metrics.idle import idling
from jbclog.analysis.metrics.joint_figures import joint_figures

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
    found: Found | None = None

    @property
    def joints(self) -> list[Joint]:
        return [] if self.found is None else self.found.joints


def measure_port(series: Series, kind: str, wire: Wire | None = None, asked: Asked | None = None) -> Measured:
    """Every metric of a port whose tool is a ``tip``, hot ``air`` or an ``omega``; joints as the recipe asks for them."""
    if kind == "omega":
        return Measured([no_figure(one.name, one.unit, NOT_OF[kind]) for one in DEFINITIONS])
    found = find_joints(series, asked) if kind == "tip" else None
    figures = [*heating(series), *idling(series), *energy(series, None if found is None or found.why else found.joints)]
    if found is not None:
        figures += [*joint_figures(series, found), *wire_figures(series, wire, found.joints)]
    return Measured(_in_order(figures, kind, found), found)


def _in_order(figures: list[Figure], kind: str, found: Found | None) -> list[Figure]:
    by_name = {figure.name: figure for figure in figures}
    why = NOT_OF[kind] if found is None or found.why is None else found.why
    return [by_name.get(one.name) or no_figure(one.name, one.unit, why) for one in DEFINITIONS]
