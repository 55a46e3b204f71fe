"""Find the joints of a port from the heat that leaves its tip.

Start with `joints.py`. It calls, in this order: `series.py` (rows to even stretches), `identify.py`
and `thermal.py` (heat balance of the tip), `contacts.py` and `draws.py` (heat draws), `feeding.py`
(feeder), `recovery.py` (what a joint does to the tip), `doubt.py` (whether the number is reliable).
Method and figures: docs/explanation/joints.md.
"""
