"""Open files that anybody may have written: never wait, never use more memory than the limit of their kind.

Start with `files.py`, then `json_reader.py` (JSON); `tables.py` loads pyarrow and `database.py` sqlite3.
"""
