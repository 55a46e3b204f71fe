"""The client of one station: asks, and decides how far to believe an answer. Generators without I/O.

Start with `robot.py`, then `dialogue.py`; `interface.py` is what a session sees of it.
"""
