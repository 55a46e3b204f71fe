"""TIP VERIFICATION. What an external thermometer says of a tip, kept for good, cited by every run, and followed when it was bad.

Owns: the file of verifications below the folder of runs, when one passes, fails or is invalid, the proposal of an adjustment,
which one a run stands on, and which runs stood on a bad one.
Never: talks to a station, writes a setting, changes a line that is in the file.
May use: `record`, `rows`, `foreign` and `errors`.
Start reading: `verification.py`, the definitions; then `book.py`, `cited.py` and `suspect.py`.
"""

from jbclog.verifying.book import NAME, Book, keep, read_book
from jbclog.verifying.cited import cited, last_valid
from jbclog.verifying.own import Own, own_of, unstable
from jbclog.verifying.suspect import Suspect, Used, where_used
from jbclog.verifying.verification import LIMIT_C, Given, Result, Verification, verify

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
