"""Files that survive a power cut: whole or not there, and lines in a chain that are only ever added."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Generic, Protocol, TypeVar

from jbclog.core.foreign.files import Kind, expect_opened
from jbclog.core.foreign.json_reader import json_of

# -- durable files ------------------------------------------------------------------------------------------------------------


def sync_folder(folder: Path) -> None:
    """Make what was created, renamed or removed in `folder` last. Raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_file(path: Path) -> None:
    """Make the contents of `path` last. Raises OSError; then the file must not be believed."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_whole(path: Path, data: bytes) -> None:
    """Put `data` at `path`: whoever looks finds the old file or the new one. Raises OSError."""
    aside = path.with_name(f".{path.name}.tmp")
    try:
        aside.unlink(missing_ok=True)
        with aside.open("xb") as file:  # never through a link that somebody has put there
            file.write(data)
        sync_file(aside)
        aside.replace(path)
    except OSError:
        aside.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def write_new(path: Path, data: bytes) -> None:
    """Put `data` at `path`, where nothing is yet, and see that it lasts. Raises OSError, and then leaves nothing there."""
    with path.open("xb") as file:
        try:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        except OSError:
            path.unlink(missing_ok=True)
            raise
    sync_folder(path.absolute().parent)


# -- chained lines ------------------------------------------------------------------------------------------------------------
# Files of JSON lines that are only ever added to, each line with the SHA-256 of the one before it and its own.
#
# A line changed, moved or taken out from between shows. That the *last* lines are gone does not show by itself: it takes the head,
# the hash of the last line, to stand elsewhere. A line that a crash cut off was never acknowledged: it is told, counts for nothing,
# and the next line is put behind it and vouches for it.
#
# Loads nothing heavy, so that a guard and a safe verb can write such files too.


class Linked(Protocol):
    """What every kind of line has: its number from 1, and the hash of the line before it."""

    @property
    def seq(self) -> int: ...

    @property
    def prev_sha256(self) -> str: ...


L = TypeVar("L", bound=Linked)
Parse = Callable[[bytes], L | None]
"""What a line says; None where it is not, to the byte, what would have been written."""


@dataclass(frozen=True, slots=True)
class Chain(Generic[L]):
    """The lines that can be read with their hashes, what is wrong (line, sentence), and the hash of the last line (`head`)."""

    said: list[L] = field(default_factory=list)
    hashes: list[str] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)
    head: str = ""


def sha256(data: bytes) -> str:
    """As it stands in the next line."""
    return hashlib.sha256(data).hexdigest()


def line_of(fields: Mapping[str, object]) -> bytes:
    """As it stands in the file: the fields, and behind them the hash of what they are without it."""
    own = sha256(json.dumps(fields, ensure_ascii=False).encode())
    return json.dumps({**fields, "sha256": own}, ensure_ascii=False).encode()


def fields_of(line: bytes) -> dict[str, object]:
    """The fields of a line without its hash. Raises ValueError, TypeError, AttributeError, KeyError or RecursionError."""
    fields: dict[str, object] = json_of(line, in_utf8=True)
    fields.pop("sha256")
    return fields


# -- reading ----------------------------------------------------------------------------------------------------------------


def chain_in(data: bytes, first: str, parse: Parse[L], *, what: str, of_first: str) -> Chain[L]:
    """Every line of `data`, and where the chain does not hold.

    `first` is what the first line must carry, `of_first` whose hash that is; `what` is what a line is called.
    """
    lines = lines_in(data)
    found: Chain[L] = Chain(head=sha256(lines[-1]) if lines else first)
    previous, seq = first, 0
    parsed = [parse(line) for line in lines]
    for number, (line, said) in enumerate(zip(lines, parsed, strict=True), 1):
        if said is None:
            if not _is_vouched_for(lines, number, parsed):
                found.wrong.append((number, _unreadable(data, lines, number, what)))
        elif said.prev_sha256 != previous:
            found.wrong.append((number, _broken(number, of_first)))
        elif said.seq != seq + 1:
            found.wrong.append((number, f"is numbered {said.seq} and follows {seq}"))
        previous = sha256(line)
        if said is not None:
            found.said.append(said)
            found.hashes.append(previous)
            seq = said.seq
    if data and not data.endswith(b"\n") and lines and parsed[-1] is not None:
        found.wrong.append((len(lines), "has lost its end"))
    return found


def _broken(number: int, of_first: str) -> str:
    if number == 1:
        return f"does not carry the hash of {of_first}: one of the two was changed"
    return "does not carry the hash of the line before it: one of the two was changed, or a line between them is gone"


def _unreadable(data: bytes, lines: list[bytes], number: int, what: str) -> str:
    if number == len(lines) and not data.endswith(b"\n"):
        return "was cut off while it was written; it counts for nothing"
    return f"is no {what}, or was changed"


def first_faults(wrong: list[tuple[int, str]], most: int = 100) -> list[tuple[int, str]]:
    """The first faults of a file, and one entry for all later ones: a file of nothing but faults must not fill a page."""
    if len(wrong) <= most:
        return wrong
    return [*wrong[:most], (wrong[most][0], f"is wrong, too, as {len(wrong) - most - 1} later lines are")]


def _is_vouched_for(lines: list[bytes], number: int, parsed: Sequence[L | None]) -> bool:
    """Whether this one was cut off, and the line behind, which was written after that, carries its hash.

    One that is whole was not cut off: it was changed, whoever wrote behind it since.
    """
    behind = parsed[number] if number < len(lines) else None
    return behind is not None and behind.prev_sha256 == sha256(lines[number - 1]) and not _is_whole(lines[number - 1])


def _is_whole(line: bytes) -> bool:
    """Whether it is JSON: the beginning of a line never is."""
    try:
        json.loads(line)
    except (ValueError, RecursionError):
        return False
    return True


def lines_in(data: bytes) -> list[bytes]:
    """Line by line; what a crash cut off is the last one."""
    lines = data.split(b"\n")
    return lines[:-1] if not lines[-1] else lines


# -- writing ----------------------------------------------------------------------------------------------------------------


def add_line(path: Path, first: str, parse: Parse[L], make: Callable[[int, str], bytes]) -> str:
    """Put a line at the end of `path`, made where it is not there; give its hash when it is on the disk. Raises OSError.

    `make` is given the line's number and what it has to carry; it is called while nobody else can write.
    """
    with _locked(path) as descriptor:
        before = os.pread(descriptor, os.fstat(descriptor).st_size, 0)
        lines = lines_in(before)
        seq = max((said.seq for line in lines if (said := parse(line)) is not None), default=0) + 1
        line = make(seq, sha256(lines[-1]) if lines else first)
        _add(descriptor, before, line)
    sync_folder(path.parent)
    return sha256(line)


Item = TypeVar("Item")
TAIL: Final = 1 << 20


def add_lines(path: Path, first: str, parse: Parse[L], items: Iterable[Item], make: Callable[[Item, int, str], bytes]) -> None:
    """Put a line for each item at the end of `path`, made where it is not there. Raises OSError.

    Reads the end of the file only, so that a long one costs no more. When it returns all lines are on the disk.
    """
    with _locked(path) as descriptor:
        before = _end_of(descriptor, parse)
        lines = lines_in(before)
        last = next((said.seq for line in reversed(lines) if (said := parse(line)) is not None), 0)
        previous, made = sha256(lines[-1]) if lines else first, list[bytes]()
        for seq, item in enumerate(items, last + 1):
            made.append(make(item, seq, previous))
            previous = sha256(made[-1])
        if made:
            _add(descriptor, before, b"\n".join(made))
    sync_folder(path.parent)


def _end_of(descriptor: int, parse: Parse[L]) -> bytes:
    """The last lines of the file, at least one that can be read among them; the whole file where there is none."""
    size = os.fstat(descriptor).st_size
    if size > TAIL:
        tail = os.pread(descriptor, TAIL, size - TAIL).partition(b"\n")[2]
        if any(parse(line) is not None for line in lines_in(tail)):
            return tail
    return os.pread(descriptor, size, 0)


@contextmanager
def _locked(path: Path) -> Iterator[int]:
    """The file, made where it is not there, for one writer at a time. Never through a link."""
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    descriptor = os.open(path, flags, 0o666)
    try:
        expect_opened(descriptor, Kind.LEDGER)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield descriptor
    finally:
        os.close(descriptor)


def _add(descriptor: int, before: bytes, line: bytes) -> None:
    """Put the line at the end, on a line of its own also behind one that was cut off, and see that it lasts."""
    data = memoryview((b"" if not before or before.endswith(b"\n") else b"\n") + line + b"\n")
    while data:
        data = data[os.write(descriptor, data) :]
    os.fsync(descriptor)
