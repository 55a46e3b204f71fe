"""Open untrusted files: without waiting, within a size limit for each kind of file.

Start with `files.py`, then `json_reader.py` (JSON); `tables.py` loads pyarrow and `database.py`
sqlite3.
"""
