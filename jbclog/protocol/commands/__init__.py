"""Command tables of each family, with unit, range, step and manual section.

Start with `command.py`, then `robot.py`; `family.py` assembles the tables.
"""
