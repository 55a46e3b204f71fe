"""One run of one station: identify it, apply the recipe, sample, survive an outage, leave the tools safe.

Start with `station_run.py`; `context.py` holds what a session is to do and what it knows.
"""
