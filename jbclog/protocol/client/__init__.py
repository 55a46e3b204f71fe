"""The client of one station: sends requests and decides which answers to accept. Coroutines without
I/O.

Start with `robot.py`, then `dialogue.py`; `interface.py` is the interface that sessions use.
"""
