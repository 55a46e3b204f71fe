"""Figures by matplotlib, in one style for page, paper and notebook. Start with `port.py`;
`trace.py` has the data that it draws.
"""
