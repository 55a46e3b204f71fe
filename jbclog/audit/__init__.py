"""THE COUNTER AUDIT. What the stations' counters said over years, how much was worked, and what is due for maintenance.

Owns: the ledger of observations and told facts, the software odometer over resets, rates, tasks and due ranges, a station's use,
and the one value (`FleetAudit`) that CSV, JSON, page and terminal are made from.
Never: writes to a station, opens a port, invents a count that nobody read: unknown is said, and bounded where it can be.
May use: `record`, `recipe` (its reader of TOML), `rows`, `cells`, `shown`, `locked` and `errors`; jinja2 for its page.
Start reading: `observed.py`, what an audit saw; then `odometer.py`, `due.py` and `fleet.py`.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jbclog.audit.book import Book, read_book
    from jbclog.audit.due import states_of
    from jbclog.audit.fleet import FleetAudit
    from jbclog.audit.gathering import fleet_of
    from jbclog.audit.history import History, histories
    from jbclog.audit.page import page_of
    from jbclog.audit.sheet import sheet_of
    from jbclog.audit.tasks import load_tasks
    from jbclog.audit.tracing import traces_of

_HOMES = {
    "Book": "book",
    "FleetAudit": "fleet",
    "History": "history",
    "fleet_of": "gathering",
    "histories": "history",
    "load_tasks": "tasks",
    "page_of": "page",
    "read_book": "book",
    "sheet_of": "sheet",
    "states_of": "due",
    "traces_of": "tracing",
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
    return getattr(import_module(f"jbclog.audit.{_HOMES[name]}"), name)
