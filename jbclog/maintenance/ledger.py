"""The ledger: one file of JSON lines, observations and facts, only ever added to, each line with the hash of the one before.

It may hold several lines' stations; they are told apart by line and name. A line that was changed or cut off is told with its
number and counts for nothing; what comes behind it still counts, and is still added: an audit's values are not lost because
somebody harmed the file. Whoever reads it has `wrong`, and ends with exit code 4 (`is_sound`).
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from jbclog.core.durable_files import Chain, add_lines, chain_in, sha256, sync_folder
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.locks import lock_of
from jbclog.maintenance.counter_totals.observed import Entry, Fact, Observation
from jbclog.maintenance.gc_pause import uncollected
from jbclog.maintenance.ledger_line import read_line, written

FIRST: Final = sha256(b"jbclog counters")  # not the file's name: whoever moves or renames a ledger keeps it
LOCK: Final = ".lock"


class AuditGoesOn(UsageError):
    """Another audit writes to this ledger now. Nothing was sent."""


@dataclass(frozen=True, slots=True)
class Book:
    """Every line that can be read, oldest first; what is wrong (line, sentence); the hash of the last line."""

    path: Path
    entries: list[Entry] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)
    head: str = FIRST

    @property
    def observations(self) -> list[Observation]:
        return [one for one in self.entries if isinstance(one, Observation)]

    @property
    def facts(self) -> list[Fact]:
        return [one for one in self.entries if isinstance(one, Fact)]

    @property
    def is_sound(self) -> bool:
        """Whether the chain holds. A last line that a crash cut off was never acknowledged, and harms nothing."""
        return all("cut off" in text for _, text in self.wrong)

    @property
    def is_foreign(self) -> bool:
        """Whether the file is something else: it has lines, and not one of them is a ledger's."""
        return not self.entries and not self.is_sound

    def expect_ledger(self) -> None:
        """Raise `RecordError` where it is something else, such as a line file: nothing is put behind that."""
        if self.is_foreign:
            raise RecordError(f"{self.path} is no ledger: no line of it is one. Nothing was put behind it; name another file")

    @property
    def sentences(self) -> tuple[str, ...]:
        return tuple(f"{self.path}: line {number} {text}" for number, text in self.wrong)


def read_book(path: Path) -> Book:
    """The ledger at `path`; an empty one where there is no file. Raises `RecordError`."""
    try:
        data = read_foreign(path, Kind.LEDGER, links=True)
    except FileNotFoundError:
        return Book(path)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {_why(error)}") from error
    with uncollected():
        found: Chain[Entry] = chain_in(data, FIRST, read_line, what="line of a ledger", of_first="a ledger's beginning")
    return Book(path, found.said, found.wrong, found.head)


def add(path: Path, entries: Iterable[Entry]) -> list[Entry]:
    """Put them at the end of the ledger, made with its folder where it is not there; give them as they stand there.

    All of them or, where the disk is full, the first of them. Raises `RecordError`.
    """
    kept: list[Entry] = []

    def made(entry: Entry, seq: int, previous: str) -> bytes:
        kept.append(replace(entry, seq=seq, prev_sha256=previous))
        return written(kept[-1])

    try:
        if not path.parent.is_dir():
            path.parent.mkdir(parents=True)
            sync_folder(path.parent.absolute().parent)
        add_lines(path, FIRST, read_line, entries, made)
    except OSError as error:
        raise RecordError(f"{path} cannot be written: {_why(error)}") from error
    return kept


def _why(error: OSError) -> str:
    return "it is a link; name the file itself" if error.errno == errno.ELOOP else error.strerror or str(error)


@contextmanager
def auditing(path: Path) -> Iterator[None]:
    """The ledger for one audit at a time. Raises `AuditGoesOn` where another has it, `RecordError` where none can be had."""
    lock = path.with_name(path.name + LOCK)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        held = lock_of(lock)
    except OSError as error:
        raise RecordError(f"{lock} cannot be made: {error.strerror or error}") from error
    if held is None:
        raise AuditGoesOn(f"another audit with the ledger {path} goes on; nothing was asked. Try again when it is through")
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(held)
