"""ONE CLIENT of one station: asks, and decides how far an answer may be believed. Generators, no I/O.

Owns: questions and answers in flight, addresses, repeats, refusals turned into errors, the turnaround that was seen, and
what a station does otherwise than recommended.
Never: opens or waits (it yields what it wants done, see `effects`), or knows what a run is.
May use: `protocol`, `commands`, `quantities`, `wire`, `errors` and `effects`.
Start reading: `robot.py`, then `dialogue.py`; `client.py` is what a session sees of it.
"""
