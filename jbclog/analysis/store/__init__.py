"""A plant's runs in one place: tables in Delta Lake
(docs/decisions/0065-a-store-is-nine-delta-tables.md).

`place.py` opens a store, `schema.py` has its tables, `identity.py` decides whether a run is in it
already, `contents.py` makes the rows of a run, `reader.py` reads them back, and `runs.py` gives
them as `Run` and `Runs`. `jbclog.app.publish` writes.
"""
