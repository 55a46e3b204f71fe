"""STATISTICAL PROCESS CONTROL. Control charts, capability and gauge studies of features, never of raw samples.

Owns: the arithmetic of the charts and indices with their constants, and the reasons for which it refuses to give them.
Never: reads a run, knows what a joint or a tip is, gives an index that would mislead. Arrays in, figures out.
May use: `errors`; numpy and scipy.
Start reading: `study.py`, what is asked for; `refusal.py`, when it is refused; `charts.py` and `capability.py`, the figures.

Sources: NIST/SEMATECH e-Handbook of Statistical Methods, chapter 6; D. C. Montgomery, Introduction to Statistical Quality
Control; L. S. Nelson, The Shewhart Control Chart: Tests for Special Causes, J. Quality Technology 16 (1984); A. F. Bissell,
How Reliable is Your Capability Index?, Applied Statistics 39 (1990); AIAG, Measurement Systems Analysis, 4th edition; ISO 22514-2.
"""

from jbclog.spc.capability import Capability, Index
from jbclog.spc.charts import (
    RUN_LENGTHS,
    Chart,
    cusum,
    ewma,
    fixed,
    individuals,
    means,
    means_by_sd,
    moving_ranges,
    ranges,
    rates,
    sds,
    shares,
)
from jbclog.spc.distribution import Fit, fitting
from jbclog.spc.equivalence import Equivalence, Mean, equivalence, equivalence_of
from jbclog.spc.gauge import GaugeStudy, gauge_study
from jbclog.spc.nelson import ALL_TESTS, DEFAULT_TESTS, FALSE_ALARMS, FalseAlarms, Signal
from jbclog.spc.refusal import Refused
from jbclog.spc.study import (
    ProbabilityPlot,
    capability,
    control_chart,
    phase_one,
    probability_plot,
    subgroup_charts,
    subgroup_charts_by_sd,
)

__all__ = [
    "ALL_TESTS",
    "DEFAULT_TESTS",
    "FALSE_ALARMS",
    "RUN_LENGTHS",
    "Capability",
    "Chart",
    "Equivalence",
    "FalseAlarms",
    "Fit",
    "GaugeStudy",
    "Index",
    "Mean",
    "ProbabilityPlot",
    "Refused",
    "Signal",
    "capability",
    "control_chart",
    "cusum",
    "equivalence",
    "equivalence_of",
    "ewma",
    "fitting",
    "fixed",
    "gauge_study",
    "individuals",
    "means",
    "means_by_sd",
    "moving_ranges",
    "phase_one",
    "probability_plot",
    "ranges",
    "rates",
    "sds",
    "shares",
    "subgroup_charts",
    "subgroup_charts_by_sd",
]
