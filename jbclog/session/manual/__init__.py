"""Read or write single values by command, or make a station safe.

Start with `read.py`, then `write.py` and `safe.py`; `names.py` and `value_text.py`
parse user input.
"""
