"""Virtual stations for the demo and the tests: physics separate from protocol, faults by name.

Start with `virtual.py`, then `device.py` and `plant.py`, the interface that all plants have;
`soldering.py` is one. `build.py` builds a station from a line file, `serve.py` serves a line on
ports. Where no manual describes a behaviour, a docstring states that of the virtual station,
which proves nothing about a real one.
"""
