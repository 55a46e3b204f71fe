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

from jbclog.analysis.joints.delay import LEAST_S as LEAST_DELAY_S
from jbclog.analysis.joints.draws import JOINT, SURE_DWELL_S, SURE_HEAT, SURE_PEAK
from jbclog.analysis.joints.joints import FoundJoints
from jbclog.analysis.joints.packed import column_of, floats_of, kinds_of
from jbclog.analysis.joints.parameters import LEAST_DWELL_S, MERGE_GAP_S, RECOVERED_WITHIN_C
from jbclog.analysis.joints.recovery import BACK_FOR_S, Joint
from jbclog.analysis.joints.series import RESOLUTION_C, RESOLUTION_PERMILLE
from jbclog.analysis.metrics.energy import NOT_RATED, Totals
from jbclog.analysis.metrics.metric import FEEDER, TIP, Basis, Value, metric, not_known
from jbclog.analysis.port_data import Floats
from jbclog.analysis.verdict.evidence import not_read
from jbclog.analysis.verdict.quantiles import censored_quantile

HALF, NEARLY_ALL = 0.5, 0.95
NONE_FOUND: Final = "No joints were found."
_EACH: Final = "Median over the joints that have it."
NO_FEEDER: Final = not_known("The tool has no feeder.")
NEVER_AT_REST: Final = "The tip was never seen at rest at a setpoint of these joints."


def why_number_not_known(port: Totals, found: FoundJoints) -> str | None:
    """Return why the number of joints of a port is not known; a gap is a reason, too."""
    return found.why or _in_gaps(port)


def _in_gaps(port: Totals) -> str | None:
    gap = port.temperature.gap or port.power.gap
    return None if gap is None else f"{gap} Joints in gaps are not known."


# -- how many --------------------------------------------------------------------------------------


@metric(
    "joints",
    "count",
    f"Draws of heat of {LEAST_DWELL_S:g} s or more, found by the tip's heat balance; contacts"
    f" less than {MERGE_GAP_S:g} s apart are one (both can be set in the recipe). With a feeder"
    " that decides, feeds too; a feed without a draw is a joint of low confidence. Null where"
    " neither heat balance nor feeder shows them. No statement about quality.",
    TIP,
)
def joints(port: Basis) -> Value:
    found, why = port.found, port.joints_why
    if why is not None and found.joints and why != found.number_why:
        why = f"{why} {len(found.joints)} were found beside them."
    likely = None if found.settings.wire_decides else _range(port)
    return counted(port, len(found.joints), why, likely)


@metric(
    "joints_kind_not_known",
    "count",
    f"Joints that may as well be wipes or touches without solder: shorter than {SURE_DWELL_S:g}"
    f" s, less than {SURE_HEAT:g} ‰·s, or never {SURE_PEAK:g} ‰; where wire decides, without a"
    " feed or without a draw.",
    TIP,
)
def joints_kind_not_known(port: Basis) -> Value:
    kinds = kinds_of(port.found.joints)
    return counted(port, len(kinds) - kinds.count(JOINT), port.joints_why)


@metric("joints_by_heat", "count", "Joints that the heat balance alone shows.", TIP)
def joints_by_heat(port: Basis) -> Value:
    return counted(port, len(port.found.by_heat), why_heat_not_known(port), _range(port))


@metric(
    "joints_by_feeder",
    "count",
    "Feeds seen in the motor's state, and those that only the counter shows.",
    FEEDER,
)
def joints_by_feeder(port: Basis) -> Value:
    feeder = port.found.feeder
    return NO_FEEDER if feeder is None else counted(port, feeder.feeds)


@metric("joints_fed_alone", "count", "Joints that only the feeder shows.", FEEDER)
def joints_fed_alone(port: Basis) -> Value:
    if port.found.feeder is None:
        return NO_FEEDER
    return counted(port, column_of(port.found.joints, "heat").count(None))


@metric(
    "joints_not_recovered",
    "count",
    "Joints that the next draw of heat followed before the tip was back.",
    TIP,
)
def joints_not_recovered(port: Basis) -> Value:
    late = column_of(port.found.joints, "recovered").count(False)
    return counted(port, late, port.found.heat_why or port.joints_why)


@metric(
    "recovered_before_next_percent",
    "%",
    "Share of the joints after which the tip was back before the next draw.",
    TIP,
)
def recovered_before_next_percent(port: Basis) -> Value:
    found = port.found
    known = [back for back in column_of(found.joints, "recovered") if back is not None]
    if not known:
        return not_known(_why_none(found))
    share = _share(known, found.joints)
    if found.why is not None:
        return not_known(found.why, len(known), share)
    return Value(100.0 * sum(known) / len(known), len(known), share, 100.0 / len(known))


def why_heat_not_known(port: Basis) -> str | None:
    found = port.found
    return found.heat_why or found.number_why or _in_gaps(port.totals)


def _range(port: Basis) -> tuple[int, int] | None:
    """Return the least and the most joints, as far as the heat balance decides; None where it shows
    none, or a gap may hide or divide some.
    """
    doubt, by_heat = port.found.doubt, len(port.found.by_heat)
    if doubt is None or not by_heat or _in_gaps(port.totals) is not None:
        return None
    return doubt.range_of(by_heat)


def counted(
    port: Basis, count: int, why: str | None = None, likely: tuple[int, int] | None = None
) -> Value:
    """Return a count of joints; `likely`: the least and the most."""
    n, coverage = len(port.found.joints), port.totals.temperature.coverage
    low, high = (None, None) if likely is None else map(float, likely)
    if why is None:
        return Value(float(count), n, coverage, 1.0, low=low, high=high)
    if low == high:  # some come and as many go: how many there are is not known
        low = high = None
    return not_known(why, n, coverage, low=low, high=high)


# -- how large -------------------------------------------------------------------------------------


@metric("joint_deficit_c", "°C", f"Setpoint minus temperature at a joint's start. {_EACH}", TIP)
def joint_deficit_c(port: Basis) -> Value:
    return _median(port, "deficit_c", RESOLUTION_C)


@metric(
    "joint_resting_below_c",
    "°C",
    "Temperature at which the tip rests at this setpoint minus temperature at a joint's start."
    f" {_EACH}",
    TIP,
)
def joint_resting_below_c(port: Basis) -> Value:
    median = _median(port, "resting_below_c", RESOLUTION_C)
    if median.value is None and port.found.joints and not port.found.levels:
        return replace(median, why=NEVER_AT_REST)
    return median


@metric(
    "joint_depth_c",
    "°C",
    f"Temperature at a joint's start minus its lowest until the tip is back. {_EACH}",
    TIP,
)
def joint_depth_c(port: Basis) -> Value:
    return _median(port, "depth_c", RESOLUTION_C)


@metric(
    "joint_dwell_s",
    "s",
    f"Time in which heat flows into the work. {_EACH} Not known where their number is not.",
    TIP,
)
def joint_dwell_s(port: Basis) -> Value:
    found = port.found
    if port.joints_why is not None and found.joints:
        return not_known(port.joints_why, len(found.joints))
    seconds = floats_of(found.joints, "dwell_s")
    dwells = np.where(np.isnan(floats_of(found.joints, "heat")), np.nan, seconds)
    return _median_of(found, dwells, port.totals.period_s)


@metric(
    "joint_heat_permille_s",
    "‰·s",
    f"Heat that went into the work, above what holds the tip. {_EACH}",
    TIP,
)
def joint_heat_permille_s(port: Basis) -> Value:
    return _median(port, "heat", RESOLUTION_PERMILLE * port.totals.period_s)


@metric(
    "joint_heat_j",
    "J",
    "The same × full-scale power / 1000, where the line file declares that power.",
    TIP,
)
def joint_heat_j(port: Basis) -> Value:
    rated_w = port.totals.rated_w
    if rated_w is None:
        median = _median(port, "heat_j", None)
        return median if median.value is not None else not_known(NOT_RATED)
    resolution = RESOLUTION_PERMILLE * port.totals.period_s * rated_w / 1000
    return _median(port, "heat_j", resolution)


@metric(
    "joint_energy_permille_s",
    "‰·s",
    f"Power above holding power from the joint's start until the tip is back. {_EACH}",
    TIP,
)
def joint_energy_permille_s(port: Basis) -> Value:
    return _median(port, "energy", RESOLUTION_PERMILLE * port.totals.period_s)


def _median(port: Basis, column: str, resolution: float | None) -> Value:
    return _median_of(port.found, floats_of(port.found.joints, column), resolution)


def _median_of(found: FoundJoints, of_each: Floats, resolution: float | None) -> Value:
    values = of_each[~np.isnan(of_each)]
    if not len(values):
        return not_known(_why_none(found))
    median = float(np.median(values))
    return Value(median, len(values), _share(values, found.joints), resolution)


def _why_none(found: FoundJoints) -> str:
    if found.joints:
        return next((why for why in column_of(found.joints, "why") if why), "No joint has it.")
    why = found.why or found.heat_why
    return why or (f"{NONE_FOUND} {not_read(found.unseen_s)}" if found.unseen_s else NONE_FOUND)


def _share(some: Sequence[object] | Floats, joints: Sequence[Joint]) -> float:
    return round(100.0 * len(some) / len(joints), 3)


# -- recovery --------------------------------------------------------------------------------------


@metric(
    "recovery_s",
    "s",
    f"From a joint's start until the tip is no more than {RECOVERED_WITHIN_C:g} °C"
    " (recovered_within_c in the recipe) below the level at which it rests at this setpoint,"
    f" for {BACK_FOR_S:g} s; below the setpoint where no rest was seen. Median; a joint that"
    " was followed by the next or cut off before is censored (Kaplan-Meier).",
    TIP,
)
def recovery_s(port: Basis) -> Value:
    return _recovery(port, HALF)


@metric("recovery_p95_s", "s", "The 95 % quantile of the same.", TIP)
def recovery_p95_s(port: Basis) -> Value:
    return _recovery(port, NEARLY_ALL)


def _recovery(port: Basis, share: float) -> Value:
    found = port.found
    recovery, had = (column_of(found.joints, name) for name in ("recovery_s", "had_s"))
    known = [(seconds, True) for seconds in recovery if seconds is not None]
    censored = [
        (longer, False)
        for seconds, longer in zip(recovery, had, strict=True)
        if seconds is None and longer is not None
    ]
    if not known:
        return not_known(_why_none(found))
    value, coverage = censored_quantile([*known, *censored], share), _share(known, found.joints)
    if value is None:
        late = column_of(found.joints, "recovered").count(False)
        why = (
            f"{late} of {len(found.joints)} joints were followed by the next before the tip was"
            " back; it lies beyond what was seen."
        )
        return not_known(why, len(known), coverage)
    return Value(value, len(known), coverage, port.totals.period_s)


# -- the tip ---------------------------------------------------------------------------------------


@metric(
    "tip_capacity_permille_s_per_k",
    "‰·s/K",
    "Heat capacity of the tip as the run shows it; the resolution is twice its standard"
    " uncertainty.",
    TIP,
)
def tip_capacity_permille_s_per_k(port: Basis) -> Value:
    model = port.found.model
    if model is None:
        return _no_model(port.found)
    capacity_uncertainty, *_ = model.uncertainties
    return _estimate(model.capacity, capacity_uncertainty)


@metric(
    "tip_loss_permille_per_k",
    "‰/K",
    "Heat that the tip gives to the air, per K above 25 °C; the same.",
    TIP,
)
def tip_loss_permille_per_k(port: Basis) -> Value:
    model = port.found.model
    if model is None:
        return _no_model(port.found)
    _, loss_uncertainty, *_ = model.uncertainties
    return _estimate(model.loss, loss_uncertainty)


@metric(
    "temperature_delay_s",
    "s",
    "By how much the station shows the temperature later than the power (negative: earlier)."
    f" Joints come earlier by it where it is at least {LEAST_DELAY_S:g} s and twice its"
    " standard uncertainty, which is the resolution; and by what the heat balance of a record"
    " with a heat-up shows beyond it.",
    TIP,
)
def temperature_delay_s(port: Basis) -> Value:
    model = port.found.model
    if model is None:
        return _no_model(port.found)
    delay = model.delay
    if delay.seconds is None or delay.uncertainty_s is None:
        return not_known(delay.why or "It was not looked for.")
    return _estimate(delay.seconds, delay.uncertainty_s)


def _no_model(found: FoundJoints) -> Value:
    return not_known(found.heat_why or f"{len(found.models)} tools were used.")


def _estimate(value: float, uncertainty: float) -> Value:
    """Return an estimate, within twice its standard uncertainty."""
    twice = 2 * uncertainty
    return Value(value, 1, None, twice, low=value - twice, high=value + twice)
