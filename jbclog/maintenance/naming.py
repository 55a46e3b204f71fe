"""Which station and which task somebody means, of those that a ledger and its files know; not found, the nearest names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Final

from jbclog.config.task_names import STATED
from jbclog.core.errors import UsageError
from jbclog.maintenance.ledger import Book

USUAL: Final = ("tip-change", "cartridge-change", "pump-filter", "feeder-rollers", "feeder-cutter", "verification", "service")
"""Tasks that can be told without a tasks file."""
MOST_NEAR: Final = 3

Place = tuple[str, str]
"""A line's name and a station's."""


def place_of(wanted: str, book: Book, also: Iterable[Place] = ()) -> Place:
    """The station called ``NAME`` or ``LINE/NAME`` in the ledger or in `also`. Raises `UsageError`."""
    known = {(one.line, one.station) for one in book.entries} | set(also)
    found = sorted(one for one in known if wanted in (one[1], "/".join(one)))
    if len(found) == 1:
        return found[0]
    if found:
        raise UsageError(f"--station {wanted}: several lines have one of that name; give {' or '.join(map('/'.join, found))}")
    if not known:
        raise UsageError(f"{book.path} knows no station yet: name its ledger with --ledger, audit first, or give --line")
    raise UsageError(f"--station {wanted}: {book.path} has no station of that name; {_near(wanted, {name for _, name in known})}")


def expect_port(port: int | None, place: Place, book: Book) -> None:
    """Raise `UsageError` where the station, as it was seen last, has no such port: what is told of it would count for nothing."""
    last = next((one for one in reversed(book.observations) if one.seen and (one.line, one.station) == place), None)
    ports = sorted({count.port for count in last.counts}) if last is not None else []
    if port is not None and ports and port not in ports:
        has = f"its port is {ports[0]}" if len(ports) == 1 else f"its ports are {', '.join(map(str, ports))}"
        raise UsageError(f"--port {port}: {place[1]} has no such port; {has}")


def task_of(wanted: str, book: Book, names: Sequence[str] | None = None) -> str:
    """The task of that name, of the tasks file or else the usual ones, or that was told before. Raises `UsageError`."""
    known = {*STATED, *(fact.task for fact in book.facts), *(USUAL if names is None else names)}
    if wanted in known:
        return wanted
    more = "; a tasks file with others is named with --tasks" if names is None else ""
    raise UsageError(f"--task {wanted}: there is no task of that name; {_near(wanted, known)}{more}")


def _near(wanted: str, known: Iterable[str]) -> str:
    names = sorted(known)
    near = difflib.get_close_matches(wanted[:64], names, n=MOST_NEAR, cutoff=0.6)
    return f"did you mean {', '.join(near)}?" if near else f"there are {', '.join(names)}"
