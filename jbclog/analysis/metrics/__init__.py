"""The metrics of one port: heat-up, idle error, drift, energy, and figures of its joints.

Start with `definitions.py`, which defines every metric and its unit; `measures.py` computes them
all.
"""
