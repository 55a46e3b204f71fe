"""Reads the counters of stations for an audit, or takes them from the record of the run that holds
the line.

Start with `run_audit.py`, then `survey.py` and `questions.py`. Nothing here writes to a station, or
clears a value by reading it.
"""
