"""The metrics of one port: heat-up, idle error, drift, energy, and figures of its joints.

Start with `definitions.py`, which defines every metric and its unit; `measures.py` computes them
all, by `heating.py`, `idling.py`, `energy.py` (with all that is a sum over the rows, `Totals`),
`joint_figures.py`, and `analysis/joints/solder_wire.py`.
"""
