"""A run as a page, a PDF, tables and JSON; an audit as a page. The same run gives the same bytes.

Start with `write.py`, then `facts.py`; `page.py` is the page, `paper.py` the PDF,
`jbclog/analysis/figures` draws.
"""
