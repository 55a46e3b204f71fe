"""THE COUNTER AUDIT. What the stations' counters said over years, how much was worked, and what is due for maintenance.

Owns: the ledger of observations and told facts, the software odometer over resets, rates, tasks and due ranges, a station's use,
and the one value (`FleetAudit`) that CSV, JSON, page and terminal are made from.
Never: writes to a station, opens a port, invents a count that nobody read: unknown is said, and bounded where it can be.
May use: `record`, `recipe` (its reader of TOML), `rows`, `cells`, `shown`, `locked` and `errors`; jinja2 for its page.
Start reading: `observed.py`, what an audit saw; then `odometer.py`, `due.py` and `fleet.py`.
"""
