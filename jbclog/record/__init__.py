"""THE RECORD. Keeps rows safe from the moment they are handed over, and turns a run into files that anyone can read.

Owns: the schema of the four tables, the run's folder, the live store, sealing into Parquet, the manifest and its
ledger, recovery after a crash, the check of a finished run, and the files of the wires beside it (`wire.py`,
`wire_recorder.py`).
Never: makes up a value, forgets a loss silently, changes a sealed run, talks to a station, imports pandas.
May use: `rows`, `tape`, `clock`, `errors`, `foreign`, `same_port` and `locked`; sqlite3 and pyarrow.
Start reading: `schema.py`, then `live.py` (rows into SQLite), `seal.py` (SQLite into Parquet), `recover.py`.
"""
