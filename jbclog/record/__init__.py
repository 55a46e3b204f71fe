"""Store a run's rows safely, and turn the run into files that anyone can read and check.

Start with `schema.py`, then `live.py` (rows into SQLite), `seal.py` (SQLite into Parquet),
`recover.py` and `check.py`.
"""
