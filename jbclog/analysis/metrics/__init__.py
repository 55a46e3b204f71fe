"""The metrics of one port: heat-up, idle error, drift, energy, and joint statistics.

Start with `definitions.py`, which defines every metric and its unit. `measures.py` computes them,
with `heating.py`, `idling.py`, `energy.py` (with `Totals`, all sums over the rows),
`joint_figures.py`, and `analysis/joints/solder_wire.py`.
"""
