"""All metrics of one port in the order of their definitions, each with a value or the reason why it
has none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from jbclog.analysis.joints.figure import Figure
from jbclog.analysis.joints.joints import FoundJoints, find_joints
from jbclog.analysis.joints.parameters import JointOptions
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.solder_wire import Wire, wire_figures
from jbclog.analysis.joints.sweeps import PortSweeps
from jbclog.analysis.joints.windows import TakesRows, View, Windows, whole
from jbclog.analysis.metrics import energy, feeder, heating, idling, joint_figures
from jbclog.analysis.metrics.energy import totals_of
from jbclog.analysis.metrics.heating import Heating
from jbclog.analysis.metrics.idling import Idling
from jbclog.analysis.metrics.joint_figures import why_number_not_known
from jbclog.analysis.metrics.metric import REGISTERED, Basis, Metric, not_known

MODULES: Final = (heating, idling, joint_figures, energy, feeder)
METRICS: Final[Mapping[str, Metric]] = {
    metric.name: metric
    for module in MODULES
    for metric in REGISTERED
    if metric.measure.__module__ == module.__name__
}
"""Every metric by its name, in the order of the report."""

NOT_OF: Final = {
    "omega": "An OMEGA tells neither temperature nor power, only its states.",
    "air": "Hot air: what it heats shows neither in its own temperature nor in its power.",
}
"""Kind of tool -> why it does not have the metrics of other tools."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The metrics of a port, the joints behind some of them, and why the number of these is not
    known.
    """

    figures: list[Figure]
    found: FoundJoints | None = None
    number_why: str | None = None

    @property
    def joints(self) -> Sequence[Joint]:
        return [] if self.found is None else self.found.joints


class PortFigures:
    """Figures of a port from its rows, added window by window."""

    def __init__(self, like: Series) -> None:
        """`like` has the port's period, rated power and the time at which it was ordered to work;
        its rows are not used.
        """
        self.like = like
        self._totals = totals_of(like)
        self._heating = Heating(like.ordered_s)
        self._idling = Idling(like.period_s)

    def take(self, view: View) -> None:
        """Add the next window; each row is in exactly one."""
        own = view.own_rows
        self._totals.take(own)
        self._heating.take(view)
        self._idling.take(own)

    def measured(self, kind: str, found: FoundJoints | None, wire: Sequence[Figure]) -> Measured:
        """Return every metric, once all rows are added."""
        self._idling.end()
        why = None if found is None else why_number_not_known(self._totals, found)
        port = Basis(
            self._totals,
            self._heating.heat_ups,
            self._idling,
            found,
            why,
            {figure.name: figure for figure in wire},
        )
        figures = []
        for metric in METRICS.values():
            if found is None and "air" not in metric.of:
                figures.append(metric.named(not_known(NOT_OF[kind])))
            else:
                figures.append(metric.figure(port))
        return Measured(figures, found, why)


def measure_port(
    series: Series, kind: str, wire: Wire | None = None, options: JointOptions | None = None
) -> Measured:
    """Return every metric of a port whose tool is a ``tip``, hot ``air`` or an ``omega``; `options`
    are those for joints.
    """
    if kind == "omega":
        return nothing_measured()
    found = find_joints(series, options) if kind == "tip" else None
    port = PortFigures(series)
    port.take(whole(series))
    return port.measured(
        kind, found, [] if found is None else wire_figures(series, wire, found.joints)
    )


def nothing_measured() -> Measured:
    """Return the metrics of a tool that reports neither temperature nor power; none has a value."""
    reason = not_known(NOT_OF["omega"])
    return Measured([metric.named(reason) for metric in METRICS.values()])


class PortMeasuring:
    """The sweeps over a port without a feeder, as `PortSweeps`; its metrics are then `measured`."""

    def __init__(self, kind: str, like: Series, options: JointOptions) -> None:
        self._kind, self._figures = kind, PortFigures(like)
        self._joints = PortSweeps(options, observe=self._figures.take) if kind == "tip" else None
        self._steps = iter([] if kind == "omega" else [Windows(self._figures.take)])

    def next_sweep(self) -> TakesRows | None:
        return next(self._steps, None) if self._joints is None else self._joints.next_sweep()

    @property
    def measured(self) -> Measured:
        if self._kind == "omega":
            return nothing_measured()
        found = None if self._joints is None else self._joints.found
        wire = [] if found is None else wire_figures(self._figures.like, None, found.joints)
        return self._figures.measured(self._kind, found, wire)
