"""Figures by matplotlib, in one style for page, paper and notebook. Start with `port.py`; `trace.py` is what it draws."""
