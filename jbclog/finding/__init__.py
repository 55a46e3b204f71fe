"""WHO ANSWERS. Finds out which station stands behind a port, and says what is wrong where none does. Generators, no I/O.

Owns: the order in which line formats and addresses are tried, the few questions that are asked, what is learnt of who
answers, and the finding with its one step where something does not.
Never: asks anything that changes a station, opens a port (it yields what it wants done, see `effects`), or knows a run.
May use: `station`, `protocol`, `commands`, `quantities`, `wire`, `errors` and `effects`.
Start reading: `scan.py`, then `trials.py`; `diagnosis.py` turns what came into findings.
"""
