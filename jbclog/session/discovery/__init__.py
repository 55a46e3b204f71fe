"""Find out which station is connected to a port, or why none can be driven. Sends only harmless
reads.

Start with `port_scan.py`, then `scan_plan.py`; `diagnosis.py` turns the results into findings.
"""
