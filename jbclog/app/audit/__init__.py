"""Reads the counters of stations for an audit; if a run holds a line, reads them from its record.

Start with `run_audit.py`, then `survey.py` and `questions.py`. Nothing here writes to a station, or
clears a value by reading it.
"""
