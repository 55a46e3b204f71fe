"""THE COUNTER AUDIT. What the stations' counters said over years, how much was worked, and what is due for maintenance.

Owns: the ledger of observations and told facts, rates, tasks and due ranges, a station's use, and the one value (`FleetAudit`)
that CSV, JSON, page and terminal are made from.
Never: writes to a station, opens a port, invents a count that nobody read: unknown is said, and bounded where it can be.
May use: `odometer`, `record`, `recipe` (its reader of TOML), `rows`, `cells`, `shown`, `locked`, `foreign` and
`errors`; jinja2 for its page.
Start reading: `gathering.py`, from the ledger to the value of a fleet; then `due.py`, `use.py` and `fleet.py`.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jbclog.audit.book import Book, read_book
    from jbclog.audit.due import states_of
    from jbclog.audit.fleet import FleetAudit
    from jbclog.audit.gathering import fleet_of
    from jbclog.audit.page import page_of
    from jbclog.audit.sheet import sheet_of
    from jbclog.audit.tasks import load_tasks
    from jbclog.odometer.history import History, histories
    from jbclog.odometer.tracing import traces_of

_HOMES = {
    "Book": "audit.book",
    "FleetAudit": "audit.fleet",
    "History": "odometer.history",
    "fleet_of": "audit.gathering",
    "histories": "odometer.history",
    "load_tasks": "audit.tasks",
    "page_of": "audit.page",
    "read_book": "audit.book",
    "sheet_of": "audit.sheet",
    "states_of": "audit.due",
    "traces_of": "odometer.tracing",
}
"""Public names and the files that they live in; loaded when they are used."""

__all__ = [
    "Book",
    "FleetAudit",
    "History",
    "fleet_of",
    "histories",
    "load_tasks",
    "page_of",
    "read_book",
    "sheet_of",
    "states_of",
    "traces_of",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"jbclog.audit has no {name!r}; it has {', '.join(__all__)}")
    return getattr(import_module(f"jbclog.{_HOMES[name]}"), name)
