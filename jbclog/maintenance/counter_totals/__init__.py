"""The advance of a counter over years of audits.

Start with `observed.py`, then `totals.py` (kinds), `judging.py` (rules) and `tracing.py`.
"""
