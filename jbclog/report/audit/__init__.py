"""The counter audit as a page, as CSV and as JSON.

Start with `page.py`, then `overview.py`; `plots.py` draws, `files.py` writes CSV and JSON.
"""
