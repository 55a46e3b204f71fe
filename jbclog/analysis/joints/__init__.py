"""Find a port's joints from the heat that leaves the tip, in arrays of temperature and power.

Start with `joints.py` and what it puts together: `identify.py` and `thermal.py` (the tip), `draws.py`, `recovery.py`.
"""
