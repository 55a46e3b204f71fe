"""What each family of stations can be asked and sent: tables with unit, range, step and manual section.

Start with `command.py`, then `robot.py`; `family.py` puts the tables together.
"""
