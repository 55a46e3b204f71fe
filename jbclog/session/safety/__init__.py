"""Put tools in their safe state and prove it, for a session, the guard or a person.

Start with `secure.py`: feeder first, then each tool, in rounds, read back. The orders are in `orders.py`, whether a tool cools in
`cooling.py`.
"""
