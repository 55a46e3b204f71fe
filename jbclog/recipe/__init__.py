"""WHAT IS WANTED. Line files and recipes: read with limits, checked as a whole, turned into ordered settings.

Owns: the TOML that people write, its schema, every sentence that says what is wrong with it (file, line, key,
what is allowed, all at once), and the order in which a recipe's settings are written.
Never: talks to a station, knows what a station holds, or decides when something is written.
May use: `commands`, `quantities`, `wire`, `foreign` and `errors`; nobody else imports pydantic or tomllib for these files.
Start reading: `model.py`, then `load.py`; `line.py` is the line file, `settings.py` what a session writes.
"""
