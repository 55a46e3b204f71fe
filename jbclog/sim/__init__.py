"""Virtual stations for the demo and the tests: physics apart from protocol, faults by name.

Start with `virtual.py`, then `device.py`, `soldering.py` and `plant.py`; `serve.py` puts a line on ports. Physics is passed the
time. Where no manual says what a station does, its docstring says what the virtual one does, which proves nothing about a real
one.
"""
