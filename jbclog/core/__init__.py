"""Values with units, rows, errors, clocks, text, and files that are complete or absent. Imports
nothing of jbclog.

Start with `errors.py`, then `quantities.py` and `rows.py`; `io_requests.py` is what sessions yield
and drivers carry out.
"""
