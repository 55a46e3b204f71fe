"""FEATURES. Metrics and joints of one port, from arrays.

Owns: what heat-up time, overshoot, settling, idle error, drift, depth, recovery, energy, duty, utilisation and wire per joint
mean; how joints are found; when a figure has no value.
Never: does I/O, imports pandas, decides a verdict, says that a joint is good.
May use: `judge` (idle tip, blocks of rows) and `rows`; numpy and scipy.
Start reading: `definitions.py`, every metric in words; `figure.py` and `series.py`; then `joints.py` and what it puts
together: `identify.py` and `thermal.py` (the tip), `draws.py` (finding), `recovery.py`.
"""

from jbclog.features.asked import Asked, Taken
from jbclog.features.definitions import DEFINITIONS, Definition
from jbclog.features.drawn import Draw
from jbclog.features.figure import Figure
from jbclog.features.joints import Found, find_joints
from jbclog.features.measures import Measured, measure_port
from jbclog.features.recovery import Joint
from jbclog.features.series import Cycles, Series, nominal_period
from jbclog.features.thermal import ThermalModel
from jbclog.features.wire import Wire

__all__ = [
    "DEFINITIONS",
    "Asked",
    "Cycles",
    "Definition",
    "Draw",
    "Figure",
    "Found",
    "Joint",
    "Measured",
    "Series",
    "Taken",
    "ThermalModel",
    "Wire",
    "find_joints",
    "measure_port",
    "nominal_period",
]
