"""ONE RUN OF ONE STATION, as a generator: identify, apply, verify, sample, make safe.

Owns: what is asked in which order, what it means, and what is written down of it.
Never: does I/O, asks for the time, or knows of another station.
May use: `station`, `safety`, `scheduler`, `recipe`, `commands`, `rows`, `clock`, `effects`, `errors`, `quantities`, `wire`.
Start reading: `run.py`, which tells the story; each chapter is a file.
"""
