"""FEATURES. Metrics and joints of one port, from arrays.

Owns: what heat-up time, overshoot, settling, idle error, drift, depth, recovery, energy, duty, utilisation and wire per joint
mean; how joints are found; when a figure has no value.
Never: does I/O, imports pandas, decides a verdict, says that a joint is good.
May use: `judge` (idle tip, blocks of rows), `rows` and `errors`; numpy and scipy.
Start reading: `figure.py` and `series.py`, then `heat.py` and `joints.py`.
"""
