"""The ledger of counter audits: a chained file and the form of its lines.

It may hold stations of several production lines, identified by line and name. A damaged line is
reported with its number and ignored; the lines after it count, and new ones are still added, so
that damage loses no audit. Commands end with exit code 4 (`is_sound`).
"""

from __future__ import annotations

import errno
import os
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path
from typing import Annotated, Final, TypeVar, overload

import msgspec

from jbclog.core.chain import Chain, damage_in, line_of, sha256
from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.files import Kind, open_regular
from jbclog.core.json_files import expect_time
from jbclog.core.locks import try_lock
from jbclog.core.operating_system import sync_folder
from jbclog.core.quantities import LARGEST
from jbclog.maintenance.counter_totals.observed import (
    Count,
    Entry,
    Errors,
    Fact,
    Observation,
    Standing,
    StationLook,
)

# -- ledger line -----------------------------------------------------------------------------------
# A line is an observation or a fact, as readable JSON. Counts are ``"counts": {"1": {"work_h": 412,
# ...}}``, those without a value ``moving`` or ``unread``. Units are in the names
# (docs/reference/tables.md).

V = TypeVar("V")
Number = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
PORTS: Final = frozenset(range(64))  # a station has at most four


class _Tables(msgspec.Struct, gc=False):
    """The counts of an observation in its line: by port, then by counter."""

    counts: dict[int, dict[str, Number]] = msgspec.field(default_factory=dict)
    moving: dict[int, dict[str, tuple[Number, ...]]] = msgspec.field(default_factory=dict)
    unread: dict[int, dict[str, str]] = msgspec.field(default_factory=dict)

    def expect_ports(self) -> None:
        """Raise ValueError for a port that no station has: each is reckoned by itself."""
        if not all(one.keys() <= PORTS for one in (self.counts, self.moving, self.unread)):
            raise ValueError(f"has a port above {max(PORTS)}")

    def each(self) -> Iterator[Count]:
        for port, name, value in _each(self.counts):
            yield Count(port, name, unit_of(name), value)
        for port, name, values in _each(self.moving):
            yield Count(port, name, unit_of(name), None, Standing.MOVING, values)
        for port, name, why in _each(self.unread):
            yield Count(port, name, unit_of(name), None, Standing.UNREAD, why=why)


_TABLES: Final = msgspec.json.Decoder(_Tables)
_LOOK: Final = msgspec.json.Decoder(StationLook)
_FACT: Final = msgspec.json.Decoder(Fact)
_SHARED: Final = [one.name for one in fields(StationLook)]


def _each(table: Mapping[int, Mapping[str, V]]) -> Iterator[tuple[int, str, V]]:
    return (
        (port, name, value) for port, counters in table.items() for name, value in counters.items()
    )


@cache
def unit_of(counter: str) -> str:
    """Return the unit in a counter's name: ``h``, ``mm`` or ``count``."""
    return {"h": "h", "mm": "mm"}.get(counter.rpartition("_")[2], "count")


def written(entry: Entry) -> bytes:
    """Format an entry with its own hash, without the line's end."""
    return line_of(_fields(entry))


def _fields(entry: Entry) -> dict[str, object]:
    plain: dict[str, object] = msgspec.to_builtins(entry, str_keys=True, enc_hook=list)  # `Counts`
    return plain | _tables_of(entry.counts) if isinstance(entry, Observation) else plain


def _tables_of(counts: Sequence[Count]) -> dict[str, object]:
    tables: dict[str, dict[str, dict[str, object]]] = {"counts": {}, "moving": {}, "unread": {}}
    for one in counts:
        name, value = _cell(one)
        tables[name].setdefault(str(one.port), {})[one.counter] = value
    return {name: table for name, table in tables.items() if table or name == "counts"}


def _cell(one: Count) -> tuple[str, object]:
    if one.standing is Standing.OK:
        return "counts", one.value
    return ("moving", list(one.values)) if one.standing is Standing.MOVING else ("unread", one.why)


def read_entry(body: bytes) -> Entry:
    """Parse the JSON of a line, whose times must be comparable. Raises ValueError."""
    try:
        return _observation(body)
    except (ValueError, RecursionError):  # a fact, or neither
        pass
    try:
        return _fact(body)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _fact(body: bytes) -> Fact:
    fact = _FACT.decode(body)
    for time in (fact.time, fact.told):
        expect_time(time)
    return fact


def _observation(body: bytes) -> Observation:
    look = _LOOK.decode(body)
    for time in (look.time, look.audit, look.errors.until):
        expect_time(time)
    tables = _TABLES.decode(body)
    tables.expect_ports()
    return Observation(
        **{name: getattr(look, name) for name in _SHARED}, counts=tuple(tables.each())
    )


# -- looks in memory -------------------------------------------------------------------------------
# A ledger has hundreds of thousands of looks. What one repeats of the look before is kept once, and
# its counters as bare numbers.

Name = tuple[int, str]
"""Port and counter."""
OF_A_STATION: Final = (
    "line",
    "station",
    "url",
    "why",
    "source",
    "identity",
    "tool_names",
    "parameters",
)


class Counts(Sequence[Count]):
    """The counts of a look: the values of those with these names, then the others."""

    __slots__ = ("_names", "_others", "_values")

    def __init__(
        self, names: tuple[Name, ...], values: array[float], others: tuple[Count, ...]
    ) -> None:
        self._names, self._values, self._others = names, values, others

    def __len__(self) -> int:
        return len(self._names) + len(self._others)

    def __iter__(self) -> Iterator[Count]:
        for (port, counter), value in zip(self._names, self._values, strict=True):
            yield Count(port, counter, unit_of(counter), value)
        yield from self._others

    @overload
    def __getitem__(self, place: int) -> Count: ...
    @overload
    def __getitem__(self, place: slice) -> tuple[Count, ...]: ...
    def __getitem__(self, place: int | slice) -> Count | tuple[Count, ...]:
        return tuple(self)[place]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Counts | tuple) and tuple(self) == tuple(other)

    def __hash__(self) -> int:
        return hash(tuple(self))

    def __repr__(self) -> str:
        return repr(tuple(self))


class _Reader:
    """Parses the entries of one ledger in their order."""

    def __init__(self) -> None:
        self._names: dict[tuple[Name, ...], tuple[Name, ...]] = {}
        self._of_station: dict[tuple[str, str], Observation] = {}
        self._before: Observation | None = None

    def __call__(self, body: bytes) -> Entry:
        entry = read_entry(body)
        if isinstance(entry, Observation):
            self._keep(entry)
        return entry

    def _keep(self, look: Observation) -> None:
        earlier = self._of_station.get((look.line, look.station))
        if earlier is not None:
            _share(look, earlier, OF_A_STATION)
            _share(look.errors, earlier.errors, ("station", "ports", "events"))
        if self._before is not None:
            _share(look, self._before, ("audit",))
            _share(look.errors, self._before.errors, ("until",))
        object.__setattr__(look, "counts", self._counts(look.counts))
        self._of_station[look.line, look.station] = self._before = look

    def _counts(self, counts: Sequence[Count]) -> Counts:
        read = [one for one in counts if one.standing is Standing.OK]
        names = tuple((one.port, one.counter) for one in read)
        values = array("d", (one.value for one in read if one.value is not None))
        others = tuple(one for one in counts if one.standing is not Standing.OK)
        return Counts(self._names.setdefault(names, names), values, others)


def _share(one: Observation | Errors, other: Observation | Errors, names: Iterable[str]) -> None:
    """Let `one`, which nobody has yet, have the values of `other` where they are equal."""
    for name in names:
        value = getattr(other, name)
        if getattr(one, name) == value:
            object.__setattr__(one, name, value)


# -- ledger ----------------------------------------------------------------------------------------

# not the file's name, so that a ledger can be moved and renamed
FIRST: Final = sha256(b"jbclog counters")
LOCK: Final = ".lock"


class AuditInProgress(UsageError):
    """Another audit uses this ledger. Nothing was sent."""


@dataclass(frozen=True, slots=True)
class Book:
    """Every readable line, oldest first; what is wrong (line, sentence), at most 101; the hash of
    the last line.
    """

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
        """Whether the chain holds. A last line that a crash cut off was never acknowledged."""
        return not damage_in(self.wrong)

    @property
    def is_foreign(self) -> bool:
        """Whether the file is no ledger: it has lines, but none of a ledger."""
        return not self.entries and not self.is_sound

    def expect_ledger(self) -> None:
        """Raise `RecordError` for another kind of file, such as a line file: nothing is added to
        it.
        """
        if self.is_foreign:
            raise RecordError(
                f"{self.path} is not a ledger: none of its lines is valid. Nothing was added; name"
                " another file"
            )

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is wrong, a sentence each."""
        return tuple(f"{self.path}: line {number} {text}" for number, text in self.wrong)


def read_book(path: Path) -> Book:
    """Return the ledger at `path`; an empty one if there is no file. Raises `RecordError`."""
    try:
        with open_regular(path, Kind.LEDGER, links=True) as file:
            content = _chain(path, _Reader()).content(file)
    except FileNotFoundError:
        return Book(path)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {_why(error, path)}") from error
    return Book(path, content.entries, content.wrong, content.head)


def add(path: Path, entries: Iterable[Entry]) -> list[Entry]:
    """Append entries to the ledger, which is made with its folder if needed; return them as
    written.

    On a full disk only the first of them may be written. Raises `RecordError`.
    """
    try:
        if not path.parent.is_dir():
            path.parent.mkdir(parents=True)
            sync_folder(path.parent.absolute().parent)
        kept = _chain(path, read_entry).append(*entries)
    except OSError as error:
        raise RecordError(f"{path} cannot be written: {_why(error, path)}") from error
    return [entry for _, entry in kept]


def _chain(path: Path, build: Callable[[bytes], Entry]) -> Chain[Entry]:
    return Chain(
        path,
        Kind.LEDGER,
        build,
        what="line of a ledger",
        first=FIRST,
        of_first="a ledger's beginning",
        fields=_fields,
    )


def _why(error: OSError, path: Path) -> str:
    if error.errno == errno.ELOOP:
        return "it is a link; name the file itself"
    return write_failure(error, path)


@contextmanager
def auditing(path: Path) -> Iterator[None]:
    """Lock the ledger for one audit. Raises `UsageError` for a path without a name, such as ``.``,
    `AuditInProgress` during another one, `RecordError` if the lock cannot be made.
    """
    if not path.name:
        raise UsageError(f"the ledger {path} is a folder; name a file in it")
    lock = path.with_name(path.name + LOCK)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        held = try_lock(lock)
    except OSError as error:
        raise RecordError(f"{lock} cannot be made: {write_failure(error, lock)}") from error
    if held is None:
        raise AuditInProgress(
            f"another audit uses the ledger {path}; nothing was sent. Try again when it has"
            " finished"
        )
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(held)
