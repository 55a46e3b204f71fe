"""Counters over years, maintenance tasks with due dates, and tip verifications.

Start with `fleet_of_ledger.py`, from the ledger to the figures of every station; then `due.py`,
`use.py` and `fleet.py`.
"""
