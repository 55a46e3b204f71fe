"""Verifications of tips against an external thermometer, and the runs that rest on each.

Start with `verification.py`, the definitions; then `verifications_file.py`, `cited.py` and `suspect.py`.
"""

from jbclog.maintenance.verification.cited import cited, last_valid
from jbclog.maintenance.verification.station_reading import Own, own_of, unstable
from jbclog.maintenance.verification.suspect import Suspect, Used, where_used
from jbclog.maintenance.verification.verification import LIMIT_C, Given, Result, Verification, verify
from jbclog.maintenance.verification.verifications_file import NAME, Book, keep, read_book

__all__ = [
    "LIMIT_C",
    "NAME",
    "Book",
    "Given",
    "Own",
    "Result",
    "Suspect",
    "Used",
    "Verification",
    "cited",
    "keep",
    "last_valid",
    "own_of",
    "read_book",
    "unstable",
    "verify",
    "where_used",
]
