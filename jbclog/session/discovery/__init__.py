"""Find out which station is connected to a port, or why none can be driven. Sends only harmless
reads.

Start with `scan.py`, then `found.py`; `diagnosis.py` turns the results into findings.
"""
