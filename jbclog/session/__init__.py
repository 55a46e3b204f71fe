"""What jbclog does with one station, as generators without I/O: run it, make it safe, read, write, find it.

Start with `run/station_run.py`; each chapter of it is a file. `scheduler.py` decides which reading is due when.
"""
