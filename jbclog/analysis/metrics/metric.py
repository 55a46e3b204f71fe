"""A metric: a function from the measured rows of a port to a figure, with name, unit and text.

`@metric(name, unit, text)` registers a function. `METRICS` in `measures.py` has all of them in the
order of the report; the tables of metrics in the documents, in `metric_definitions` and in ``jbclog
trend`` are made from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from jbclog.analysis.joints.figure import Figure
from jbclog.analysis.joints.joints import FoundJoints

if TYPE_CHECKING:
    from jbclog.analysis.metrics.energy import Totals
    from jbclog.analysis.metrics.heating import HeatUp
    from jbclog.analysis.metrics.idling import Idling

METHODS: Final = 5
"""Version of the metrics. Raise it when a metric is added or removed, and when a record gives
another figure or reason; derived tables of older versions are then ignored.
"""
TIP: Final = ("tip",)
AIR: Final = ("tip", "air")
FEEDER: Final = ("feeder",)
"""The tools that have a metric."""


@dataclass(frozen=True, slots=True)
class Basis:
    """What the rows of a port show: sums over them, heat-ups, idle readings, joints and wire.

    `joints` None: the tool makes none. `joints_why`: why their number is not known.
    """

    totals: Totals
    heat_ups: Sequence[HeatUp]
    idling: Idling
    joints: FoundJoints | None = None
    joints_why: str | None = None
    wire: Mapping[str, Figure] = field(default_factory=dict)

    @property
    def found(self) -> FoundJoints:
        """The joints, for metrics of tools that make some."""
        assert self.joints is not None
        return self.joints


@dataclass(frozen=True, slots=True)
class Value:
    """A figure without its name and unit (`joints/figure.py`); without a value, `why` has the
    reason.
    """

    value: float | None
    n: int
    coverage: float | None = None
    resolution: float | None = None
    why: str | None = None
    low: float | None = None
    high: float | None = None


def not_known(
    why: str,
    n: int = 0,
    coverage: float | None = None,
    *,
    low: float | None = None,
    high: float | None = None,
) -> Value:
    """Return no value, with the reason as a sentence; its range may be known."""
    return Value(None, n, coverage, None, why, low, high)


Measuring = Callable[[Basis], Value]


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric: name, unit, definition, the tools that have it, and its function."""

    name: str
    unit: str
    text: str
    of: tuple[str, ...]
    measure: Measuring

    def figure(self, port: Basis) -> Figure:
        """Return the figure of a port."""
        return self.named(self.measure(port))

    def named(self, value: Value) -> Figure:
        """Return a value with name and unit."""
        return Figure(
            self.name,
            value.value,
            self.unit,
            value.n,
            value.coverage,
            value.resolution,
            value.why,
            value.low,
            value.high,
        )


REGISTERED: Final[list[Metric]] = []
"""Metrics in the order of their modules' imports, and of the functions in each."""


def metric(
    name: str, unit: str, text: str, of: tuple[str, ...] = AIR
) -> Callable[[Measuring], Measuring]:
    """Register the function of a metric."""

    def registered(function: Measuring) -> Measuring:
        REGISTERED.append(Metric(name, unit, text, of, function))
        return function

    return registered
