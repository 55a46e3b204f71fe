"""Quantities and units, row types, errors, clocks, text, and crash-safe files. Imports no other
package of jbclog.

Start with `errors.py`, then `quantities.py` and `rows.py`; `io_requests.py` is the interface
between sessions and drivers.
"""
