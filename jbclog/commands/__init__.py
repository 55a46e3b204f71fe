"""MEANING. What each family of stations can be asked and told: tables, without any I/O.

Owns: commands with value type, unit, range, step and manual section; tools, errors and status words;
which signals are sampled and which counters are read; what an answer can be at all.
Never: frames a command, sends one, or decides when.
May use: `quantities` and `errors` only.
Start reading: `command.py`, then `robot.py`; `family.py` puts the tables together.
"""
