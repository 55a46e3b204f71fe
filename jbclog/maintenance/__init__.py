"""Counters over years, maintenance tasks and when they fall due, and verifications of tips.

Start with `fleet_of_ledger.py`, from the ledger to the figures of every station; then `due.py`,
`use.py` and `fleet.py`.
"""
