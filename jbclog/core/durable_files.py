"""Crash-safe files (complete or absent after a power cut), and append-only JSON lines in a hash
chain.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Generic, Protocol, TypeVar

from jbclog.core.files import LONGEST_LINE, Kind, Line, each_line, expect_opened
from jbclog.core.json_files import json_of
from jbclog.core.operating_system import (
    NO_LINK,
    NO_WAIT,
    PLAIN,
    read_at,
    sync_file,
    sync_folder,
    wait_for_lock,
)
from jbclog.core.text import count_text


def write_whole(path: Path, data: bytes) -> None:
    """Replace `path` atomically with `data`, synced. Raises OSError."""
    aside = path.with_name(f".{path.name}.tmp")
    try:
        aside.unlink(missing_ok=True)
        with aside.open("xb") as file:  # never follows a link
            file.write(data)
        sync_file(aside)
        aside.replace(path)
    except OSError:
        aside.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def write_new(path: Path, data: bytes) -> None:
    """Create `path` with `data`, synced. On failure, removes the file and raises OSError."""
    with path.open("xb") as file:
        try:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        except OSError:
            path.unlink(missing_ok=True)
            raise
    sync_folder(path.absolute().parent)


# Hash-chained lines: each line of JSON carries the SHA-256 of the previous line and its own.
#
# A changed, moved or missing line breaks the chain. Missing last lines show only by comparison with
# the head, the hash of the last line, kept elsewhere. A line cut off by a crash was never
# acknowledged: it is reported, does not count, and the next line carries its hash.


class ChainedLine(Protocol):
    """A parsed line: its number from 1, and the hash of the previous line."""

    @property
    def seq(self) -> int: ...

    @property
    def prev_sha256(self) -> str: ...


L = TypeVar("L", bound=ChainedLine)
Parse = Callable[[bytes], L | None]
"""Parses a line; returns None unless it is byte for byte what jbclog writes."""


@dataclass(frozen=True, slots=True)
class LineChain(Generic[L]):
    """The readable lines with their hashes, problems as (line number, text), and the hash of the
    last line (`head`).
    """

    entries: list[L] = field(default_factory=list)
    hashes: list[str] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)
    head: str = ""


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def line_of(fields: Mapping[str, object]) -> bytes:
    """Format a line: the fields, then their hash."""
    own = sha256(json.dumps(fields, ensure_ascii=False).encode())
    return json.dumps({**fields, "sha256": own}, ensure_ascii=False).encode()


def fields_of(line: bytes) -> dict[str, object]:
    """Parse a line and drop its hash. Raises ValueError."""
    fields = json_of(line)
    if not isinstance(fields, dict) or "sha256" not in fields:
        raise ValueError("no chained line")
    return {name: value for name, value in fields.items() if name != "sha256"}


def chain_in(data: bytes, first: str, parse: Parse[L], *, what: str, of_first: str) -> LineChain[L]:
    """Parse every line of `data` and list where the chain breaks.

    `first` is the hash that the first line must carry, `of_first` names what was hashed, `what`
    names a line.
    """
    texts = lines_in(data)
    last = 0 if data.endswith(b"\n") else len(texts)
    lines = (Line(text, sha256(text), number != last) for number, text in enumerate(texts, 1))
    return chain_of(lines, first, parse, what=what, of_first=of_first)


def chain_of(
    lines: Iterable[Line],
    first: str,
    parse: Parse[L],
    *,
    what: str,
    of_first: str,
) -> LineChain[L]:
    """Parse the lines as `chain_in` does."""
    found: LineChain[L] = LineChain()
    previous, seq, number = first, 0, 0
    # an invalid line, until the next one shows whether a crash cut it off
    unread: Line | None = None
    line: Line | None = None
    for number, line in enumerate(lines, 1):
        entry = None if line.text is None else parse(line.text)
        if unread is not None and not _was_cut_off(unread, entry):
            found.wrong.append((number - 1, _unreadable(unread, what)))
        if entry is not None:
            if entry.prev_sha256 != previous:
                found.wrong.append((number, _broken(number, of_first)))
            elif entry.seq != seq + 1:
                found.wrong.append((number, f"is numbered {entry.seq} and follows {seq}"))
            found.entries.append(entry)
            found.hashes.append(line.sha256)
            seq = entry.seq
        previous, unread = line.sha256, line if entry is None else None
    if unread is not None:
        found.wrong.append((number, _unreadable(unread, what)))
    elif line is not None and not line.is_ended:
        found.wrong.append((number, "has lost its end"))
    return replace(found, head=previous)


def _broken(number: int, of_first: str) -> str:
    if number == 1:
        return f"does not carry the hash of {of_first}: one of the two was changed"
    return (
        "does not carry the hash of the line before it: one of the two was changed, or a line"
        " between them is gone"
    )


CUT_OFF: Final = "was cut off while it was written; it counts for nothing"


def damage_in(wrong: Iterable[tuple[int, str]]) -> list[str]:
    """Return the problems except lines cut off by a crash, which were never acknowledged."""
    return [f"line {number} {text}" for number, text in wrong if text != CUT_OFF]


def _unreadable(line: Line, what: str) -> str:
    if line.text is None:
        return f"has more than {LONGEST_LINE} bytes; it counts for nothing"
    if not line.is_ended:
        return CUT_OFF
    return f"is no {what}, or was changed"


MOST_FAULTS: Final = 100


def first_faults(wrong: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return the first `MOST_FAULTS` faults; the last entry counts the rest, so that a ruined file
    does not fill a page.
    """
    if len(wrong) <= MOST_FAULTS:
        return wrong
    later = len(wrong) - MOST_FAULTS - 1
    too = f", and {count_text(later, 'later line')} with it" if later else ""
    return [*wrong[:MOST_FAULTS], (wrong[MOST_FAULTS][0], f"is wrong{too}")]


def _was_cut_off(line: Line, behind: L | None) -> bool:
    """Return True if a crash cut off this line and the next one carries its hash. A complete line
    was changed, not cut off.
    """
    return (
        behind is not None
        and behind.prev_sha256 == line.sha256
        and line.text is not None
        and not _is_json(line.text)
    )


def _is_json(line: bytes) -> bool:
    """Return True if the line is valid JSON; a truncated line never is."""
    try:
        json.loads(line)
    except (ValueError, RecursionError):
        return False
    return True


def lines_in(data: bytes) -> list[bytes]:
    """Split into lines; a crash may have cut off the last one."""
    lines = data.split(b"\n")
    return lines[:-1] if not lines[-1] else lines


def add_line(path: Path, first: str, parse: Parse[L], make: Callable[[int, str], bytes]) -> str:
    """Append a line to `path`, created if missing, and sync; return the line's hash. Raises
    OSError.

    `make` takes the line's number and the previous hash; the file is locked meanwhile.
    """
    with _locked(path) as descriptor:
        before = read_at(descriptor, os.fstat(descriptor).st_size, 0)
        lines = lines_in(before)
        seq = (
            max((entry.seq for line in lines if (entry := parse(line)) is not None), default=0) + 1
        )
        line = make(seq, sha256(lines[-1]) if lines else first)
        _add(descriptor, line, is_ended=not before or before.endswith(b"\n"))
    sync_folder(path.parent)
    return sha256(line)


Item = TypeVar("Item")
TAIL: Final = 1 << 20


def add_lines(
    path: Path,
    first: str,
    parse: Parse[L],
    items: Iterable[Item],
    make: Callable[[Item, int, str], bytes],
) -> None:
    """Append a line for each item to `path`, created if missing, and sync. Raises OSError.

    Reads only the end of the file, so the cost does not grow with its length.
    """
    with _locked(path) as descriptor:
        last, end = _end_of(descriptor, parse)
        previous, made = end.sha256 if end else first, list[bytes]()
        for seq, item in enumerate(items, last + 1):
            made.append(make(item, seq, previous))
            previous = sha256(made[-1])
        if made:
            _add(descriptor, b"\n".join(made), is_ended=end is None or end.is_ended)
    sync_folder(path.parent)


def _end_of(descriptor: int, parse: Parse[L]) -> tuple[int, Line | None]:
    """Return the number of the last readable line (0: none), and the last line. Reads the whole
    file only if its end has no readable line.
    """
    size, last, line = os.fstat(descriptor).st_size, 0, None
    for start in (max(size - TAIL, 0), 0):
        with os.fdopen(os.dup(descriptor), "rb") as file:
            file.seek(start)
            if start:
                file.readline(TAIL)
            for line in each_line(file):
                entry = None if line.text is None else parse(line.text)
                last = last if entry is None else entry.seq
        if last or not start:
            break
    return last, line


@contextmanager
def _locked(path: Path) -> Iterator[int]:
    """Open the file, created if missing, and lock it for one writer. Never follows a link."""
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | PLAIN | NO_LINK | NO_WAIT
    descriptor = os.open(path, flags, 0o666)
    try:
        expect_opened(descriptor, Kind.LEDGER)
        wait_for_lock(descriptor)
        yield descriptor
    finally:
        os.close(descriptor)


def _add(descriptor: int, line: bytes, *, is_ended: bool) -> None:
    """Append the line and sync; start a new line if the last one was cut off."""
    data = memoryview((b"" if is_ended else b"\n") + line + b"\n")
    while data:
        data = data[os.write(descriptor, data) :]
    os.fsync(descriptor)
