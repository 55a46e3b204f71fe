"""FEATURES. Metrics and joints of one port, from arrays.

Owns: what heat-up time, overshoot, settling, idle error, drift, depth, recovery, energy, duty, utilisation and wire per joint
mean; how joints are found; when a figure has no value.
Never: does I/O, imports pandas, decides a verdict, says that a joint is good.
May use: `judge` (idle tip, blocks of rows) and `rows`; numpy and scipy.
Start reading: `definitions.py`, every metric in words; `figure.py` and `series.py`; `heat.py` and `joints.py`.
"""

from jbclog.features.definitions import DEFINITIONS, Definition
from jbclog.features.figure import Figure
from jbclog.features.joints import Draw, Found, find_joints
from jbclog.features.measures import Measured, measure_port
from jbclog.features.recovery import Dip, dips, heat_of
from jbclog.features.series import Series, nominal_period
from jbclog.features.wire import Wire

__all__ = [
    "DEFINITIONS",
    "Definition",
    "Dip",
    "Draw",
    "Figure",
    "Found",
    "Measured",
    "Series",
    "Wire",
    "dips",
    "find_joints",
    "heat_of",
    "measure_port",
    "nominal_period",
]
