"""Read or write one value by hand, or make a station safe, for the person who asked.

Start with `read.py`, then `write.py` and `safe.py`; `names.py` and `values.py` parse what a person types.
"""
