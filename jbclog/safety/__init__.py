"""SAFE STATE. How tools are put in their safe state and what proves it, for whoever has to: a session, the guard, a hand.

Owns: the order of doing it (feeder first, then each tool, in rounds), the tries and the time they may take, the reading
back, and when an order counts.
Never: opens or waits (generators, see `effects`), decides which tools were touched, or records anything.
May use: `station`, `commands`, `quantities`, `effects` and `errors`.
Start reading: `secure.py`.
"""
