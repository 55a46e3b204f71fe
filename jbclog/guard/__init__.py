"""A small process that makes tools safe if the recorder dies or hangs.

Start with `watch.py`, then `takeover.py`; `supervisor.py` is the recorder's side, `__main__.py` the
guard's.
"""
