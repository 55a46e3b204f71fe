"""Publishes sealed runs into a store, and maintains the store. Start with `publisher.py`, then
`commits.py` and `upkeep.py`.
"""
