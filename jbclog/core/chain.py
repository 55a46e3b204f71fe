"""Files of JSON lines in a hash chain: each line carries the SHA-256 of the line before it
(`prev_sha256`) and its own (`sha256`).

A changed, moved or missing line breaks the chain. Missing last lines show only by comparison with
the head, the hash of the last line, kept elsewhere. A line that a crash cut off was never
acknowledged: it counts for nothing, is reported while it is the last, and the next line carries its
hash.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any, Final, Generic, Protocol, TypeVar

from jbclog.core.files import Kind, read_regular
from jbclog.core.line_file import END, LineFile, content_end
from jbclog.core.operating_system import read_at
from jbclog.core.text import count_text

CUT_OFF: Final = "was cut off while it was written; it counts for nothing"
END_LOST: Final = "has lost its end"
LEFT_BY_CRASH: Final = (CUT_OFF, END_LOST)
MOST_FAULTS: Final = 100
OWN: Final = b', "sha256": "'
TAIL: Final = 1 << 20


class ChainedLine(Protocol):
    """A line as a dataclass: its number from 1, and the hash of the line before."""

    @property
    def seq(self) -> int: ...

    @property
    def prev_sha256(self) -> str: ...


L = TypeVar("L", bound=ChainedLine)


@dataclass(frozen=True, slots=True)
class Content(Generic[L]):
    """What a chained file has.

    `lines`: the hash of each line with its entry, None for one that cannot be read. `wrong`:
    problems as (line number, text), at most `MOST_FAULTS` and the count of the others. `head`: the
    hash of the last line.
    """

    lines: list[tuple[str, L | None]] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)
    head: str = ""

    @property
    def entries(self) -> list[L]:
        return [entry for _, entry in self.lines if entry is not None]

    @property
    def damage(self) -> list[str]:
        """The problems except those that a crash leaves: such a line was never acknowledged."""
        return damage_in(self.wrong)


class Chain(LineFile, Generic[L]):
    """The chained file at `path`.

    `build` makes an entry of a line's JSON without its hash, or raises ValueError; `fields` makes
    the JSON's fields of an entry; `what` names a line. `first` is the hash that the first line
    carries, that of `of_first`.
    """

    def __init__(
        self,
        path: Path,
        kind: Kind,
        build: Callable[[bytes], L],
        *,
        what: str,
        first: str = "",
        of_first: str = "the file's name",
        fields: Callable[[Any], Mapping[str, object]] = asdict,
        creates: bool = True,
    ) -> None:
        super().__init__(path, kind, creates=creates)
        self.first = first or sha256(path.name.encode())
        self._build = build
        self._what = what
        self._of_first = of_first
        self._fields = fields

    def append(self, *entries: L) -> list[tuple[str, L]]:
        """Append entries; return each as written, numbered and linked, with the hash of its line.

        Costs the same however long the file is. Raises OSError; the first entries may be written.
        """
        kept: list[tuple[str, L]] = []
        lines: list[bytes] = []
        with self._opened(creates=self._creates) as descriptor:
            end = content_end(descriptor)
            seq, previous = self._last(descriptor, end)
            for number, entry in enumerate(entries, seq + 1):
                plain: Any = entry
                linked: L = replace(plain, seq=number, prev_sha256=previous)
                lines.append(line_of(self._fields(linked)))
                previous = sha256(lines[-1])
                kept.append((previous, linked))
            if lines:
                self._add(descriptor, end, END.join(lines))
        return kept

    def read(self) -> Content[L]:
        """Read the file; without it, no lines. Raises OSError."""
        try:
            data = read_regular(self.path, self.kind)
        except FileNotFoundError:
            return Content(head=self.first)
        return self.content(BytesIO(data))

    def content(self, lines: Iterable[bytes]) -> Content[L]:
        """Return the content of these lines with their ends, and where the chain breaks."""
        read: list[tuple[str, L | None]] = []
        wrong: list[tuple[int, str]] = []
        previous = self.first
        seq = 0
        torn = 0  # the last lines that a crash may have cut off
        line = b""
        for number, line in enumerate(lines, 1):
            text = line.removesuffix(END)
            entry = self._entry(text)
            if entry is None:
                wrong.append((number, f"is no {self._what}, or was changed"))
            else:
                if entry.prev_sha256 != previous:
                    wrong.append((number, self._broken(number)))
                elif entry.seq != seq + 1:
                    wrong.append((number, f"is numbered {entry.seq} and follows {seq}"))
                elif torn:
                    del wrong[-torn:]
                seq = entry.seq
            torn = torn + 1 if entry is None and not _is_json(text) else 0
            previous = sha256(text)
            read.append((previous, entry))
        if line and not line.endswith(END):
            if read[-1][1] is not None:
                wrong.append((len(read), END_LOST))
            elif torn:
                wrong[-torn:] = [(number, CUT_OFF) for number, _ in wrong[-torn:]]
        return Content(read, first_faults(wrong), previous)

    def _entry(self, line: bytes) -> L | None:
        body = body_of(line)
        if body is None:
            return None
        try:
            return self._build(body)
        except ValueError:
            return None

    def _last(self, descriptor: int, end: int) -> tuple[int, str]:
        """Return the number of the last readable line (0: none), and the hash of the last line.
        Reads the whole file only if its end has no readable line.
        """
        if not end:
            return 0, self.first
        for start in (max(end - TAIL, 0), 0):
            lines = read_at(descriptor, end - start, start).split(END)
            if start:
                del lines[0]  # its beginning is missing
            for line in reversed(lines):
                entry = self._entry(line)
                if entry is not None:
                    return entry.seq, sha256(lines[-1])
        return 0, sha256(lines[-1])

    def _broken(self, number: int) -> str:
        if number == 1:
            return f"does not carry the hash of {self._of_first}: one of the two was changed"
        return (
            "does not carry the hash of the line before it: one of the two was changed, or a line"
            " between them is gone"
        )


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def line_of(fields: Mapping[str, object]) -> bytes:
    """Format a line without its end: the fields, then their hash."""
    own = sha256(json.dumps(fields, ensure_ascii=False).encode())
    return json.dumps({**fields, "sha256": own}, ensure_ascii=False).encode()


def body_of(line: bytes) -> bytes | None:
    """Return the JSON of a line without its hash; None if the hash is not right."""
    body, own, rest = line.rpartition(OWN)
    body += b"}"
    return body if own and rest == sha256(body).encode() + b'"}' else None


def damage_in(wrong: Iterable[tuple[int, str]]) -> list[str]:
    """Return the problems except those that a crash leaves: such a line was never acknowledged."""
    return [f"line {number} {text}" for number, text in wrong if text not in LEFT_BY_CRASH]


def first_faults(wrong: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return the first `MOST_FAULTS` faults; the last entry counts the rest, so that a ruined file
    does not fill a page.
    """
    if len(wrong) <= MOST_FAULTS:
        return wrong
    later = len(wrong) - MOST_FAULTS - 1
    too = f", and {count_text(later, 'later line')} with it" if later else ""
    return [*wrong[:MOST_FAULTS], (wrong[MOST_FAULTS][0], f"is wrong{too}")]


def _is_json(line: bytes) -> bool:
    """Return True if the line is valid JSON; a truncated line never is."""
    try:
        json.loads(line)
    except (ValueError, RecursionError):
        return False
    return True
