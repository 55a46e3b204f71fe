"""Read untrusted files without blocking and within a size limit for each kind.

Start with `files.py`, then `json_files.py` (JSON); `tables.py` loads pyarrow, `database.py`
sqlite3.
"""
