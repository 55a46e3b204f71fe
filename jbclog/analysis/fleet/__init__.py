"""Work that is divided: over processes of this computer, or over the workers of a Dask scheduler.

`engine.py` chooses who computes, `processes.py` and `scheduler.py` are the two that divide, and
`moments.py` has partial results that merge to the same last digit in any order
(docs/decisions/0066-partial-results-merge-exactly.md).
"""
