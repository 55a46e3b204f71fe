"""The metrics of one port: heat-up, overshoot, idle error, drift, energy, and the figures of its joints.

Start with `definitions.py`, every metric in words with its unit; `measures.py` computes them all.
"""
