"""Which publishers are working in a store, on any host: each renews a lease there.

A lease is an empty Delta Lake table below `_publishers`, whose description names host, boot and
process. It keeps `store check` and `store vacuum` from working beside a publisher. They would be
safe without it: see `commits.fence`.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pyarrow as pa

from jbclog.analysis.store.place import Place, explained
from jbclog.analysis.store.schema import RUNS
from jbclog.core.errors import StoreError
from jbclog.core.json_files import json_of
from jbclog.core.operating_system import boot_id
from jbclog.core.text import clean, shortened

if TYPE_CHECKING:
    from deltalake import DeltaTable

FOLDER: Final = "_publishers"
VALID: Final = timedelta(hours=1)
RENEWED_S: Final = 60.0
ASKED_S: Final = 60.0  # for the holders of all leases; a server can take half a minute for each
NAME: Final = re.compile(r"[0-9a-f]{12}")
SCHEMA: Final = pa.schema([pa.field("renewed", pa.int64())])
MOST_SAID: Final = 100


@dataclass(frozen=True, slots=True)
class Holder:
    """The process that holds a lease."""

    host: str
    boot: str
    pid: int

    @property
    def is_here(self) -> bool:
        """Whether the process runs, or ran, on this computer since its last start."""
        return bool(self.boot) and self.boot == boot_id()

    @property
    def is_dead(self) -> bool:
        """Whether the process is known to have ended."""
        return self.is_here and not Path("/proc", str(self.pid)).exists()

    def __str__(self) -> str:
        return f"process {self.pid} on {shortened(clean(self.host), MOST_SAID)}"


@dataclass(frozen=True, slots=True)
class Found:
    """A lease in a store: publisher's name, process, and time of the last renewal."""

    publisher: str
    holder: Holder | None
    renewed: datetime | None

    @property
    def is_live(self) -> bool:
        """Whether its publisher may be working."""
        if self.holder is not None and self.holder.is_here:
            return not self.holder.is_dead
        return self.renewed is None or datetime.now(UTC) - self.renewed < VALID

    def __str__(self) -> str:
        when = "" if self.renewed is None else f", last seen {self.renewed:%Y-%m-%d %H:%M:%S} UTC"
        return f"{self.holder or f'publisher {self.publisher}'}{when}"


class Lease:
    """A publisher's own lease. `publisher` is its name; `new_publication` names what it
    publishes.
    """

    def __init__(self, place: Place) -> None:
        self.publisher = secrets.token_hex(6)
        self._place, self._count, self._renewed = place, 0, time.monotonic()
        with explained(place.url):
            self._table = self._made()

    def _made(self) -> DeltaTable:
        from deltalake import DeltaTable

        self._place.expect_plain(self._name)
        said = json.dumps(asdict(Holder(socket.gethostname(), boot_id(), os.getpid())))
        return DeltaTable.create(
            self._place.of(self._name),
            SCHEMA,
            description=said,
            storage_options=self._place.options,
        )

    @property
    def _name(self) -> str:
        return f"{FOLDER}/{self.publisher}"

    def new_publication(self) -> str:
        """Return a name that no other publication has."""
        self._count += 1
        return f"{self.publisher}-{self._count}"

    def renew(self) -> None:
        """Renew the lease, at most once a minute. A failure is not an error: nothing depends on a
        lease.
        """
        if time.monotonic() - self._renewed < RENEWED_S:
            return
        self._renewed = time.monotonic()
        with suppress(StoreError), explained(self._place.url):
            self._renew()

    def _renew(self) -> None:
        """Commit to the lease, or create it again if it was removed. If the whole store is gone, as
        a share may be, create nothing.
        """
        if self._place.has_table(self._name):
            self._table.create_write_transaction([], "append", SCHEMA)
        elif self._place.has_table(RUNS):
            self._table = self._made()

    def release(self) -> None:
        """Remove the lease, if the store can be written; otherwise it expires."""
        with suppress(StoreError):
            self._place.remove(self._name)


def leases(place: Place) -> Iterator[Found]:
    """Yield the leases in a store; those that were not asked for within `ASKED_S` have no holder,
    and end by their time.
    """
    written: dict[str, list[datetime | None]] = {}
    for file in place.listed(FOLDER):
        parts = Path(file.name).parts
        if len(parts) > 2 and NAME.fullmatch(parts[1]):
            written.setdefault(parts[1], []).append(file.written)
    end = time.monotonic() + ASKED_S
    for publisher, times in sorted(written.items()):
        known = [one for one in times if one is not None]
        holder = _holder(place, publisher) if time.monotonic() < end else None
        yield Found(publisher, holder, max(known) if known else None)


def live(place: Place) -> list[Found]:
    """Return the leases of publishers that may be working."""
    return [one for one in leases(place) if one.is_live]


def _holder(place: Place, publisher: str) -> Holder | None:
    try:
        facts: Any = json_of(place.table(f"{FOLDER}/{publisher}").metadata().description or "")
        return Holder(str(facts["host"]), str(facts["boot"]), int(facts["pid"]))
    except Exception:  # cut off at its start, or foreign
        return None
