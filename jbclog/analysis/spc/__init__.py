"""Control charts and capability. Takes features, never raw samples.

Start with `study.py`, then `refusal.py` (when a result is refused), `charts.py` and
`capability.py`.

Sources: NIST/SEMATECH e-Handbook of Statistical Methods, chapter 6; D. C. Montgomery, Introduction
to Statistical Quality Control; L. S. Nelson, The Shewhart Control Chart: Tests for Special Causes,
J. Quality Technology 16 (1984); A. F. Bissell, How Reliable is Your Capability Index?, Applied
Statistics 39 (1990); ISO 22514-2.
"""

from jbclog.analysis.spc.capability import Capability, Index
from jbclog.analysis.spc.charts import (
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
from jbclog.analysis.spc.distribution import Fit, fitting
from jbclog.analysis.spc.equivalence import Equivalence, Mean, equivalence, equivalence_of
from jbclog.analysis.spc.nelson import ALL_TESTS, DEFAULT_TESTS, FALSE_ALARMS, FalseAlarms, Signal
from jbclog.analysis.spc.refusal import Refused
from jbclog.analysis.spc.study import (
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
