"""Statistics of a port's joints: number, depth, deficit, dwell, heat, energy and recovery.

Recovery is censored: for a joint followed by the next one, or cut off, only a lower bound is known.
Median and 95 % quantile are those of the product-limit estimate (E. L. Kaplan and P. Meier, Journal
of the American Statistical Association 53, 1958); if the estimate does not reach that share, the
quantile is not known. `n` is the number of joints with a value, `coverage` their share of all
joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jbclog.analysis.joints.draws import JOINT
from jbclog.analysis.joints.figure import Figure, no_figure
from jbclog.analysis.joints.joints import FoundJoints
from jbclog.analysis.joints.packed import column_of, floats_of, kinds_of
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import RESOLUTION_C, RESOLUTION_PERMILLE
from jbclog.analysis.joints.thermal import Delay
from jbclog.analysis.metrics.energy import NOT_RATED, Totals
from jbclog.analysis.verdict.evidence import not_read
from jbclog.analysis.verdict.idle import Floats
from jbclog.analysis.verdict.quantiles import censored_quantile

HALF, NEARLY_ALL = 0.5, 0.95
NONE_FOUND: Final = "No joints were found."
NEVER_AT_REST: Final = "The tip was never seen at rest at a setpoint of these joints."


def why_number_not_known(port: Totals, found: FoundJoints) -> str | None:
    """Return why the number of joints of a port is not known; a gap is a reason, too."""
    return found.why or _in_gaps(port)


def _in_gaps(port: Totals) -> str | None:
    gap = port.temperature.gap or port.power.gap
    return None if gap is None else f"{gap} Joints in gaps are not known."


def joint_figures(port: Totals, found: FoundJoints) -> list[Figure]:
    """Return every figure of the joints of a port."""
    joints = found.joints
    period, heat = port.period_s, RESOLUTION_PERMILLE * port.period_s
    joules = None if port.rated_w is None else heat * port.rated_w / 1000
    return [
        *_counts(port, found),
        _median_figure(
            "joint_deficit_c", "°C", RESOLUTION_C, found, floats_of(joints, "deficit_c")
        ),
        _resting_below(found),
        _median_figure("joint_depth_c", "°C", RESOLUTION_C, found, floats_of(joints, "depth_c")),
        _dwell(port, found),
        _median_figure("joint_heat_permille_s", "‰·s", heat, found, floats_of(joints, "heat")),
        _median_figure("joint_heat_j", "J", joules, found, floats_of(joints, "heat_j")),
        _median_figure("joint_energy_permille_s", "‰·s", heat, found, floats_of(joints, "energy")),
        _recovery("recovery_s", HALF, period, found),
        _recovery("recovery_p95_s", NEARLY_ALL, period, found),
        _recovered(found),
        *_model_figures(found),
    ]


def _counts(port: Totals, found: FoundJoints) -> list[Figure]:
    coverage, joints = port.temperature.coverage, found.joints
    unknown = len(joints) - kinds_of(joints).count(JOINT)
    why = why_number_not_known(port, found)
    heat_why = found.heat_why or found.number_why or _in_gaps(port)
    feeder = found.feeder
    alone = column_of(joints, "heat").count(None)
    counts = (
        ("joints", len(joints), why),
        ("joints_kind_not_known", unknown, why),
        (
            "joints_not_recovered",
            column_of(joints, "recovered").count(False),
            found.heat_why or why,
        ),
        ("joints_by_heat", len(found.by_heat), heat_why),
        ("joints_by_feeder", None if feeder is None else feeder.feeds, None),
        ("joints_fed_alone", None if feeder is None else alone, None),
        ("feeds_without_draw", None if feeder is None else feeder.feeds_without_draw, heat_why),
        ("draws_without_feed", None if feeder is None else feeder.draws_without_feed, heat_why),
    )
    beside = f" {len(joints)} were found beside them." if joints and why != found.number_why else ""
    return [
        _count(
            name,
            count,
            f"{reason}{beside}" if reason and name == "joints" else reason,
            len(joints),
            coverage,
        )
        for name, count, reason in counts
    ]


def _count(name: str, count: int | None, why: str | None, n: int, coverage: float) -> Figure:
    if count is None:
        return no_figure(name, "count", "The tool has no feeder.")
    if why is not None:
        return no_figure(name, "count", why, n, coverage)
    return Figure(name, float(count), "count", n, coverage, 1.0)


def _why_none(found: FoundJoints) -> str:
    if found.joints:
        return next((why for why in column_of(found.joints, "why") if why), "No joint has it.")
    why = found.why or found.heat_why
    return why or (f"{NONE_FOUND} {not_read(found.unseen_s)}" if found.unseen_s else NONE_FOUND)


def _median_figure(
    name: str,
    unit: str,
    resolution: float | None,
    found: FoundJoints,
    of_each: Floats,
) -> Figure:
    values = of_each[~np.isnan(of_each)]
    if not len(values):
        is_not_rated = unit == "J" and resolution is None
        return no_figure(name, unit, NOT_RATED if is_not_rated else _why_none(found))
    return Figure(
        name, float(np.median(values)), unit, len(values), _share(values, found.joints), resolution
    )


def _dwell(port: Totals, found: FoundJoints) -> Figure:
    """Return the figure; where the number of joints is not known, their edges are not either."""
    why = why_number_not_known(port, found)
    if why is not None and found.joints:
        return no_figure("joint_dwell_s", "s", why, len(found.joints))
    seconds = floats_of(found.joints, "dwell_s")
    dwells = np.where(np.isnan(floats_of(found.joints, "heat")), np.nan, seconds)
    return _median_figure("joint_dwell_s", "s", port.period_s, found, dwells)


def _resting_below(found: FoundJoints) -> Figure:
    """Return the figure; if the tip was never at rest, that is the reason given."""
    figure = _median_figure(
        "joint_resting_below_c",
        "°C",
        RESOLUTION_C,
        found,
        floats_of(found.joints, "resting_below_c"),
    )
    return (
        figure
        if figure.value is not None or found.levels or not found.joints
        else replace(figure, why=NEVER_AT_REST)
    )


def _recovery(name: str, share: float, period: float, found: FoundJoints) -> Figure:
    recovery, had = (column_of(found.joints, name) for name in ("recovery_s", "had_s"))
    known = [(seconds, True) for seconds in recovery if seconds is not None]
    censored = [
        (longer, False)
        for seconds, longer in zip(recovery, had, strict=True)
        if seconds is None and longer is not None
    ]
    if not known:
        return no_figure(name, "s", _why_none(found))
    value = censored_quantile([*known, *censored], share)
    if value is None:
        late = column_of(found.joints, "recovered").count(False)
        why = (
            f"{late} of {len(found.joints)} joints were followed by the next before the tip was"
            " back; it lies beyond what was seen."
        )
        return no_figure(name, "s", why, len(known), _share(known, found.joints))
    return Figure(name, value, "s", len(known), _share(known, found.joints), period)


def _recovered(found: FoundJoints) -> Figure:
    name = "recovered_before_next_percent"
    known = [one for one in column_of(found.joints, "recovered") if one is not None]
    if not known:
        return no_figure(name, "%", _why_none(found))
    if found.why is not None:
        return no_figure(name, "%", found.why, len(known), _share(known, found.joints))
    return Figure(
        name,
        100.0 * sum(known) / len(known),
        "%",
        len(known),
        _share(known, found.joints),
        100.0 / len(known),
    )


def _model_figures(found: FoundJoints) -> list[Figure]:
    """Return the tip's capacity, loss and delay if there was a single tool; the resolution is twice
    the standard error.
    """
    names = (("tip_capacity_permille_s_per_k", "‰·s/K"), ("tip_loss_permille_per_k", "‰/K"))
    model = found.model
    if model is None:
        why = found.heat_why or f"{len(found.models)} tools were used."
        return [no_figure(name, unit, why) for name, unit in (*names, ("temperature_delay_s", "s"))]
    values = zip(names, (model.capacity, model.loss), model.uncertainties, strict=False)
    return [
        *(Figure(name, value, unit, 1, None, 2 * unsure) for (name, unit), value, unsure in values),
        _delay(model.delay),
    ]


def _delay(delay: Delay) -> Figure:
    if delay.seconds is None or delay.uncertainty_s is None:
        return no_figure("temperature_delay_s", "s", delay.why or "It was not looked for.")
    return Figure("temperature_delay_s", delay.seconds, "s", 1, None, 2 * delay.uncertainty_s)


def _share(some: Sequence[object] | Floats, joints: Sequence[Joint]) -> float:
    return round(100.0 * len(some) / len(joints), 3)
