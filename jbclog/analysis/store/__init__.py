"""A store: the runs of a plant in one place, as tables of Delta Lake
(docs/decisions/0065-a-store-is-nine-delta-tables.md).

Start with `place.py`, which opens a store, and `schema.py`, which has its tables. `identity.py`
decides whether a store has a run already, `contents.py` makes the rows of a run, `reader.py` reads
them, and `runs.py` returns them as `Run` and `Runs`. `jbclog.app.publish` writes.
"""
