"""BY HAND. What a person asks for: a value read or written, a station made safe; as generators that do no I/O.

Owns: finding a command by name, a value in a person's text and back, who answers, what a write by hand owes its user: the
value before, one sending, a reading back; which answer is believed; what is dangerous, and the snapshot before it.
Never: opens or waits (it yields what it wants done, see `effects`), prints, or writes a file.
May use: `safety`, `station`, `commands`, `quantities`, `wire`, `errors` and `effects`.
Start reading: `read.py`, then `write.py` and `safe.py`; `names.py` and `values.py` are what a person types.
"""
