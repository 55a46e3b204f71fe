"""Diagnose this machine's setup and the stations of a line, and suggest one step for each finding.

Start with `examine.py`, then `disk.py`, `clock.py` and `ports.py` for the machine and `stations.py` for a line.
"""
