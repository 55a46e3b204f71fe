"""FILES THAT MAY BE ANYBODY'S. One way to open each kind of them: never a wait, never more memory than the kind's limit.

Owns: opening regular files only, limits by kind, JSON with limits and by type hints, Parquet by row groups with limits, SQLite that
trusts nothing, the look at a network mount that may hang.
Never: knows what a file means, or decides what to do without it.
May use: nothing of jbclog but `errors`.
Start reading: `files.py`, then `numbers.py`; `tables.py` and `database.py` load pyarrow and sqlite3.
"""
