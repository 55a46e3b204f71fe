"""Alarm episodes of a tool, by three detectors: the station's flags, our samples with delays, every
sampled excursion.

Start with `state_machine.py`, then `port_watch.py`; `live.py` feeds it while a run is recorded,
`from_record.py` from its record. Terms and states are those of ISA-18.2 / IEC 62682 as in OPC UA
Part 9 (OPC 10000-9): on-delay, off-delay, deadband, acknowledgement independent of the state.

Nothing is imported here: a recorder evaluates alarms without what reads them from a record.
"""
