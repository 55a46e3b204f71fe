"""A run as a page, a PDF, tables and JSON; an audit as a page. The same run gives the same bytes.

Start with `write.py`, then `facts.py`; `trace.py` and `figure.py` draw, `svg.py` writes drawings down; `paper.py` is the PDF.
"""
