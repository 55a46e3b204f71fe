"""Solder wire of a feeder; the figures of its counters are those of `joints/solder_wire.py`."""

from __future__ import annotations

from jbclog.analysis.joints.solder_wire import LEAST_READINGS, PUSHED_S
from jbclog.analysis.metrics.joint_figures import NO_FEEDER, counted, why_heat_not_known
from jbclog.analysis.metrics.metric import FEEDER, Basis, Value, metric


@metric("wire_mm", "mm", "Dispensed length, last reading of the counter minus the first.", FEEDER)
def wire_mm(port: Basis) -> Value:
    return _of_wire(port, "wire_mm")


@metric(
    "wire_feeds", "count", "Dispensing cycles, last reading of the counter minus the first.", FEEDER
)
def wire_feeds(port: Basis) -> Value:
    return _of_wire(port, "wire_feeds")


@metric("feeds_without_draw", "count", "Feeds in which the tip drew no heat that shows.", FEEDER)
def feeds_without_draw(port: Basis) -> Value:
    feeder = port.found.feeder
    if feeder is None:
        return NO_FEEDER
    return counted(port, feeder.feeds_without_draw, why_heat_not_known(port))


@metric("draws_without_feed", "count", "Draws of heat in which no wire was seen pushed.", FEEDER)
def draws_without_feed(port: Basis) -> Value:
    feeder = port.found.feeder
    if feeder is None:
        return NO_FEEDER
    return counted(port, feeder.draws_without_feed, why_heat_not_known(port))


@metric(
    "wire_per_joint_mm",
    "mm",
    "Dispensed length over the joints found between the two readings.",
    FEEDER,
)
def wire_per_joint_mm(port: Basis) -> Value:
    return _of_wire(port, "wire_per_joint_mm")


@metric("wire_per_feed_mm", "mm", "Dispensed length over dispensing cycles.", FEEDER)
def wire_per_feed_mm(port: Basis) -> Value:
    return _of_wire(port, "wire_per_feed_mm")


@metric(
    "wire_delivered_percent", "%", "Wire per feed as a share of the length that is set.", FEEDER
)
def wire_delivered_percent(port: Basis) -> Value:
    return _of_wire(port, "wire_delivered_percent")


@metric(
    "wire_speed_mm_s",
    "mm/s",
    f"Dispensed length over the time in which the motor was seen pushing; {LEAST_READINGS}"
    " readings of it at least.",
    FEEDER,
)
def wire_speed_mm_s(port: Basis) -> Value:
    return _of_wire(port, "wire_speed_mm_s")


@metric(
    "wire_clog_suspicions",
    "count",
    f"How often the motor was seen pushing for {PUSHED_S:g} s or more between two readings of"
    " the length that show no progress.",
    FEEDER,
)
def wire_clog_suspicions(port: Basis) -> Value:
    return _of_wire(port, "wire_clog_suspicions")


def _of_wire(port: Basis, name: str) -> Value:
    figure = port.wire[name]
    return Value(
        figure.value,
        figure.n,
        figure.coverage,
        figure.resolution,
        figure.why,
        figure.low,
        figure.high,
    )
