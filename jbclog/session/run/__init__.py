"""One run of one station: identify it, apply the recipe, sample, bridge outages, make the tools
safe.

Start with `station_run.py`; `context.py` has a session's task and its state.
"""
