"""Virtual stations for the demo and the tests: physics separate from protocol, faults by name.

Start with `virtual.py`, then `device.py`, `soldering.py` and `plant.py`; `serve.py` serves a line
on ports. Where no manual describes a behaviour, a docstring states that of the virtual station,
which proves nothing about a real one.
"""
