"""Every metric with its unit and definition, in the order of the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from jbclog.analysis.joints.delay import LEAST_S as LEAST_DELAY_S
from jbclog.analysis.joints.draws import SURE_DWELL_S, SURE_HEAT, SURE_PEAK
from jbclog.analysis.joints.parameters import LEAST_DWELL_S, MERGE_GAP_S, RECOVERED_WITHIN_C
from jbclog.analysis.joints.recovery import BACK_FOR_S
from jbclog.analysis.joints.solder_wire import LEAST_READINGS, PUSHED_S
from jbclog.analysis.metrics.energy import AT_LEAST_PERMILLE
from jbclog.analysis.metrics.heating import AFTER_S, BAND_C, CALM_C, HOLD_S, LEAST_RISE_C
from jbclog.analysis.metrics.idling import LEAST_DRIFT_S, LEAST_MEANS, MEAN_S


@dataclass(frozen=True, slots=True)
class Definition:
    """One metric: name, unit, definition, and the tools that have it: ``tip``, ``air``,
    ``feeder``.
    """

    name: str
    unit: str
    text: str
    of: tuple[str, ...] = ("tip", "air")


METHODS: Final = 4
"""Version of the metrics. Raise it when a metric is added or removed, and when a record gives
another figure or reason; caches of older versions are then ignored.
"""

TIP, FEEDER = ("tip",), ("feeder",)
_EACH = "Median over the joints that have it."

DEFINITIONS: Final = (
    Definition(
        "heat_up_time_s",
        "s",
        f"From the order to work, or from a setting raised by {LEAST_RISE_C:g} °C or more, with a"
        f" tip more than {BAND_C:g} °C below its setting, until it first enters setting ±"
        f" {BAND_C:g} °C and stays there for {HOLD_S:g} s. Median over the heat-ups.",
    ),
    Definition(
        "overshoot_c",
        "°C",
        f"Highest temperature minus setting in the {AFTER_S:g} s after that entry, or until setting"
        " or state change. Median.",
    ),
    Definition(
        "settling_time_s",
        "s",
        f"From the same beginning until the last moment in these {AFTER_S:g} s at which the tip is"
        f" further than {CALM_C:g} °C from its setting. Median.",
    ),
    Definition(
        "idle_error_c",
        "°C",
        "Mean of temperature minus setting of the idle readings, which the verdict defines.",
    ),
    Definition(
        "idle_sd_c",
        "°C",
        "Standard deviation of temperature minus setting of the idle readings; none below the"
        " resolution divided by √12.",
    ),
    Definition(
        "idle_range_c",
        "°C",
        "Highest minus lowest of temperature minus setting of the idle readings.",
    ),
    Definition(
        "drift_c_per_h",
        "°C/h",
        f"Theil-Sen slope of the idle error's means over {MEAN_S:g} s each; {LEAST_MEANS} means"
        f" over {LEAST_DRIFT_S:g} s at least.",
    ),
    Definition(
        "joints",
        "count",
        f"Draws of heat of {LEAST_DWELL_S:g} s or more, found by the tip's heat balance; contacts"
        f" less than {MERGE_GAP_S:g} s apart are one (both can be set in the recipe). With a feeder"
        " that decides, feeds too; a feed without a draw is a joint of low confidence. Null where"
        " neither heat balance nor feeder shows them. No statement about quality.",
        TIP,
    ),
    Definition(
        "joints_kind_not_known",
        "count",
        f"Joints that may as well be wipes or touches without solder: shorter than {SURE_DWELL_S:g}"
        f" s, less than {SURE_HEAT:g} ‰·s, or never {SURE_PEAK:g} ‰; where wire decides, without a"
        " feed or without a draw.",
        TIP,
    ),
    Definition("joints_by_heat", "count", "Joints that the heat balance alone shows.", TIP),
    Definition(
        "joints_by_feeder",
        "count",
        "Feeds seen in the motor's state, and those that only the counter shows.",
        FEEDER,
    ),
    Definition("joints_fed_alone", "count", "Joints that only the feeder shows.", FEEDER),
    Definition(
        "joints_not_recovered",
        "count",
        "Joints that the next draw of heat followed before the tip was back.",
        TIP,
    ),
    Definition(
        "recovered_before_next_percent",
        "%",
        "Share of the joints after which the tip was back before the next draw.",
        TIP,
    ),
    Definition(
        "joint_deficit_c", "°C", f"Setpoint minus temperature at a joint's start. {_EACH}", TIP
    ),
    Definition(
        "joint_resting_below_c",
        "°C",
        "Temperature at which the tip rests at this setpoint minus temperature at a joint's start."
        f" {_EACH}",
        TIP,
    ),
    Definition(
        "joint_depth_c",
        "°C",
        f"Temperature at a joint's start minus its lowest until the tip is back. {_EACH}",
        TIP,
    ),
    Definition(
        "joint_dwell_s",
        "s",
        f"Time in which heat flows into the work. {_EACH} Not known where their number is not.",
        TIP,
    ),
    Definition(
        "joint_heat_permille_s",
        "‰·s",
        f"Heat that went into the work, above what holds the tip. {_EACH}",
        TIP,
    ),
    Definition(
        "joint_heat_j",
        "J",
        "The same × full-scale power / 1000, where the line file declares that power.",
        TIP,
    ),
    Definition(
        "joint_energy_permille_s",
        "‰·s",
        f"Power above holding power from the joint's start until the tip is back. {_EACH}",
        TIP,
    ),
    Definition(
        "recovery_s",
        "s",
        f"From a joint's start until the tip is no more than {RECOVERED_WITHIN_C:g} °C"
        " (recovered_within_c in the recipe) below the level at which it rests at this setpoint,"
        f" for {BACK_FOR_S:g} s; below the setpoint where no rest was seen. Median; a joint that"
        " was followed by the next or cut off before is censored (Kaplan-Meier).",
        TIP,
    ),
    Definition("recovery_p95_s", "s", "The 95 % quantile of the same.", TIP),
    Definition(
        "tip_capacity_permille_s_per_k",
        "‰·s/K",
        "Heat capacity of the tip as the run shows it; the resolution is twice its standard"
        " uncertainty.",
        TIP,
    ),
    Definition(
        "tip_loss_permille_per_k",
        "‰/K",
        "Heat that the tip gives to the air, per K above 25 °C; the same.",
        TIP,
    ),
    Definition(
        "temperature_delay_s",
        "s",
        "By how much the station shows the temperature later than the power (negative: earlier)."
        f" Joints come earlier by it where it is at least {LEAST_DELAY_S:g} s and twice its"
        " standard uncertainty, which is the resolution; and by what the heat balance of a record"
        " with a heat-up shows beyond it.",
        TIP,
    ),
    Definition("power_mean_permille", "‰", "Mean of the power readings while the tool works."),
    Definition(
        "energy_permille_s", "‰·s", "Integral of the power over the whole record (trapezoids)."
    ),
    Definition(
        "energy_recorded_permille_s",
        "‰·s",
        "The same over the stretches without a gap: where there is one, a lower bound.",
    ),
    Definition(
        "energy_j",
        "J",
        "energy_permille_s × full-scale power / 1000, where the line file declares that power.",
    ),
    Definition(
        "duty_percent",
        "%",
        f"Share of the working readings with {AT_LEAST_PERMILLE:g} ‰ of power or more.",
    ),
    Definition(
        "utilisation_percent", "%", "Share of the readings of the state in which the tool works."
    ),
    Definition(
        "joint_share_percent", "%", "Dwell of all joints as a share of the working time.", TIP
    ),
    Definition(
        "wire_mm", "mm", "Dispensed length, last reading of the counter minus the first.", FEEDER
    ),
    Definition(
        "wire_feeds",
        "count",
        "Dispensing cycles, last reading of the counter minus the first.",
        FEEDER,
    ),
    Definition(
        "feeds_without_draw", "count", "Feeds in which the tip drew no heat that shows.", FEEDER
    ),
    Definition(
        "draws_without_feed", "count", "Draws of heat in which no wire was seen pushed.", FEEDER
    ),
    Definition(
        "wire_per_joint_mm",
        "mm",
        "Dispensed length over the joints found between the two readings.",
        FEEDER,
    ),
    Definition("wire_per_feed_mm", "mm", "Dispensed length over dispensing cycles.", FEEDER),
    Definition(
        "wire_delivered_percent", "%", "Wire per feed as a share of the length that is set.", FEEDER
    ),
    Definition(
        "wire_speed_mm_s",
        "mm/s",
        f"Dispensed length over the time in which the motor was seen pushing; {LEAST_READINGS}"
        " readings of it at least.",
        FEEDER,
    ),
    Definition(
        "wire_clog_suspicions",
        "count",
        f"How often the motor was seen pushing for {PUSHED_S:g} s or more between two readings of"
        " the length that show no progress.",
        FEEDER,
    ),
)
