"""Store a run's rows safely, and turn the run into files that anyone can read and check.

Start with `schema.py`, then `live.py` (rows into a journal), `frames.py` (its format), `seal.py`
(the journal into Parquet), `recover.py` and `check.py`.
"""
