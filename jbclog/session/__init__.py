"""Everything that jbclog does with one station, as coroutines without I/O: run, make safe, read,
write, discover.

Start with `run/station_run.py`. `scheduler.py` decides which reading is due when.
"""
