"""The metrics of one port: heat-up, idle error, drift, energy, and joint statistics.

Start with `metric.py`. A metric is a function in `heating.py`, `idling.py`, `joint_figures.py`,
`energy.py` (with `Totals`, all sums over the rows) or `feeder.py`; `measures.py` lists and computes
them.
"""
