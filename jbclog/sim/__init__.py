"""Virtual stations for the demo and the tests: physics apart from protocol, faults by name.

Start with `virtual.py`, then `device.py`, `soldering.py` and `plant.py`; `serve.py` serves a line
on ports. Where no manual describes a station's behaviour, a docstring says what the virtual one
does, which proves nothing about a real one.
"""
