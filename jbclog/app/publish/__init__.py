"""Publishes sealed runs into a store, and keeps the store: start with `publisher.py`, then
`commits.py` and `upkeep.py`.
"""
