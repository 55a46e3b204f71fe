"""Find out which station is behind a port, or why none can be driven. Asks harmless questions only.

Start with `scan.py`, then `found.py`; `diagnosis.py` turns what came back into findings.
"""
