"""Shows a run while it is recorded, in the terminal (`terminal.py`) and as a page (`server.py` and
`static/`). Both read through `jbclog.live`; `words.py` has the texts of both.
"""
