"""The advance of a counter over years of audits, through resets, roll-overs and exchanged stations.

Start with `observed.py`, then `totals.py` (kinds and rules), `tracing.py`, `judging.py` and
`span.py`.
"""
