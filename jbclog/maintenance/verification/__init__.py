"""Verifications of tips against an external thermometer, and the runs that rest on each.

Start with `verification.py`, the definitions; then `verifications_file.py` and `suspect.py`.
"""

from jbclog.maintenance.verification.suspect import Suspect, Used, where_used
from jbclog.maintenance.verification.verification import LIMIT_C, Given, Own, Result, Verification, own_of, unstable, verify
from jbclog.maintenance.verification.verifications_file import NAME, Book, cited, keep, last_valid, read_book

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
