"""Parallel work over many runs: in processes of this computer, or on the workers of a Dask
scheduler.

`engine.py` chooses where to compute, `processes.py` and `scheduler.py` are the two parallel
engines, and `moments.py` has partial results that merge to the same last digit in any order
(docs/decisions/0066-partial-results-merge-exactly.md).
"""
