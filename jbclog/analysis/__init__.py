"""Recorded runs as pandas DataFrames, with joints, metrics, alarms, verdict, control charts and
figures.

Start with `run.py`. The sub-packages `joints`, `metrics`, `alarms`, `verdict` and `spc` take arrays
and load no pandas; `figures` draws.
"""
