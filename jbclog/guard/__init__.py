"""A small process that makes tools safe when the recorder dies or hangs.

Start with `watch.py`, then `takeover.py`; `process.py` is the recorder's end of it, `__main__.py` the guard's.
"""
