"""Runs as pandas DataFrames, and the figures drawn from them: joints, metrics, alarms, verdict,
control charts.

Start with `run.py`; the sub-packages `joints`, `metrics`, `alarms`, `verdict` and `spc` take arrays
and load no pandas; `figures` draws.
"""
