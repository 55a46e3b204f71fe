"""What came after sealing: `annotations.jsonl`, a line of JSON each, only ever added to.

Acknowledgements, late serials, tools that were made safe later. The record itself never changes once it is sealed, so
what is said of it later stands here: who, when, what, why. Each line holds the SHA-256 of the line before it, the first
one that of the manifest (the head), and its own: a line changed, moved or taken out from between shows. That the
*last* lines are gone does not show: whoever must be able to prove them notes the head that `append` gives.

A line that a crash cut off was never acknowledged. It is told, counts for nothing, and keeps nobody from going on: the
next line is put behind it and vouches for it.

    append(folder, who="jbclog guard", what="dde-1 port 1: stand", why="its recorder was killed", kind="safety.safe_state")

Loads nothing heavy, so that a guard and a safe verb can write here too.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from jbclog.errors import RecordError
from jbclog.record.durable import sync_folder

NAME: Final = "annotations.jsonl"
MANIFEST: Final = "manifest.json"
NOTE: Final = "note"
LONGEST: Final = 2000  # characters of a text
WORDS: Final = re.compile(r"[a-z][a-z_]*(\.[a-z][a-z_]*)*")


@dataclass(frozen=True, slots=True)
class Annotation:
    """One line: `time` in ISO 8601 UTC, `kind` dotted as that of events, `prev_sha256` of the line before it."""

    seq: int
    time: str
    kind: str
    who: str
    what: str
    why: str
    prev_sha256: str


@dataclass(frozen=True, slots=True)
class Annotations:
    """What was said of a run: the lines that can be read, and what is wrong with the file (line, sentence).

    `head` is the hash of the last line, of the manifest where there is none.
    """

    said: list[Annotation] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)
    head: str = ""


def append(folder: Path, *, who: str, what: str, why: str, kind: str = NOTE, utc_s: float | None = None) -> str:
    """Say something of the sealed run in `folder`; give the new head, when it is on the disk. Raises `RecordError`.

    Texts are kept without what does not show. `utc_s` is the moment in seconds since 1970, now where it is not given.
    """
    first = _first_link(folder)
    moment = datetime.now(UTC) if utc_s is None else datetime.fromtimestamp(utc_s, UTC)
    texts = {name: _fit(name, text) for name, text in (("who", who), ("what", what), ("why", why))}
    if not WORDS.fullmatch(kind):
        raise RecordError(f"{kind!r} is no kind of an annotation")
    try:
        with _locked(folder / NAME) as descriptor:
            before = _whole(descriptor)
            lines = _lines(before)
            line = _line(_next(lines, first, moment.strftime("%Y-%m-%dT%H:%M:%S.%fZ"), kind, texts))
            _add(descriptor, before, line)
        sync_folder(folder)
    except OSError as error:
        raise RecordError(f"{folder / NAME} cannot be written: {error.strerror or error}") from error
    return _hash(line)


def read(folder: Path) -> Annotations:
    """Everything that was said of the run in `folder`, and where its chain does not hold. Raises `RecordError`."""
    first = _first_link(folder)
    try:
        descriptor = os.open(folder / NAME, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        return Annotations(head=first)
    except OSError as error:
        raise RecordError(f"{folder / NAME} cannot be read: {error.strerror or error}") from error
    with os.fdopen(descriptor, "rb") as file:
        try:
            return _read(file.read(), first)
        except OSError as error:
            raise RecordError(f"{folder / NAME} cannot be read: {error.strerror or error}") from error


# -- lines ----------------------------------------------------------------------------------------------------------------


def _read(data: bytes, first: str) -> Annotations:
    lines = _lines(data)
    found = Annotations(head=_hash(lines[-1]) if lines else first)
    previous, seq = first, 0
    for number, line in enumerate(lines, 1):
        said = _parsed(line)
        if said is None:
            if not _is_vouched_for(lines, number):
                found.wrong.append((number, _unreadable(data, lines, number)))
        elif said.prev_sha256 != previous:
            found.wrong.append((number, _broken(number)))
        elif said.seq != seq + 1:
            found.wrong.append((number, f"is numbered {said.seq} and follows {seq}"))
        if said is not None:
            found.said.append(said)
            seq = said.seq
        previous = _hash(line)
    if data and not data.endswith(b"\n") and lines and _parsed(lines[-1]) is not None:
        found.wrong.append((len(lines), "has lost its end"))
    return found


def _broken(number: int) -> str:
    if number == 1:
        return "does not carry the hash of the manifest: one of the two was changed"
    return "does not carry the hash of the line before it: one of the two was changed, or a line between them is gone"


def _unreadable(data: bytes, lines: list[bytes], number: int) -> str:
    if number == len(lines) and not data.endswith(b"\n"):
        return "was cut off while it was written; it counts for nothing"
    return "is no annotation, or was changed"


def _is_vouched_for(lines: list[bytes], number: int) -> bool:
    """Whether the line behind, written when this one was cut off already, carries its hash."""
    behind = _parsed(lines[number]) if number < len(lines) else None
    return behind is not None and behind.prev_sha256 == _hash(lines[number - 1])


def _lines(data: bytes) -> list[bytes]:
    """Line by line; what a crash cut off is the last one."""
    lines = data.split(b"\n")
    return lines[:-1] if not lines[-1] else lines


def _next(lines: list[bytes], first: str, time: str, kind: str, texts: dict[str, str]) -> Annotation:
    seq = max((said.seq for line in lines if (said := _parsed(line)) is not None), default=0) + 1
    return Annotation(seq, time, kind, texts["who"], texts["what"], texts["why"], _hash(lines[-1]) if lines else first)


def _line(said: Annotation) -> bytes:
    """As it stands in the file: the fields, and behind them the hash of what they are without it."""
    fields = asdict(said)
    own = _hash(json.dumps(fields, ensure_ascii=False).encode())
    return json.dumps({**fields, "sha256": own}, ensure_ascii=False).encode()


def _parsed(line: bytes) -> Annotation | None:
    """The annotation in a line; None where it is not, to the byte, what `append` would have written."""
    try:
        fields = json.loads(line)
        own = fields.pop("sha256")
        said = Annotation(**fields)
        texts = (said.time, said.kind, said.who, said.what, said.why, said.prev_sha256, own)
        fits = type(said.seq) is int and all(isinstance(text, str) for text in texts)
        return said if fits and _line(said) == line else None
    except (ValueError, TypeError, AttributeError, KeyError, RecursionError):
        return None


def _fit(name: str, text: str) -> str:
    """Without what does not show, and not too long. Raises `RecordError` where nothing is left."""
    shown = "".join(sign if sign.isprintable() else " " for sign in text).strip()
    if not shown:
        raise RecordError(f"an annotation says {name}: nothing was given")
    return shown if len(shown) <= LONGEST else shown[: LONGEST - 1] + "…"


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


# -- files ----------------------------------------------------------------------------------------------------------------


def _first_link(folder: Path) -> str:
    """The manifest's hash. Raises `RecordError` where the run is not sealed."""
    try:
        data = (folder / MANIFEST).read_bytes()
        state = json.loads(data).get("state")
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise RecordError(f"{folder} has no manifest that can be read") from error
    if state != "sealed":
        raise RecordError(f"{folder} is not sealed: what happens now belongs into the record itself")
    return _hash(data)


@contextmanager
def _locked(path: Path) -> Iterator[int]:
    """The file, made where it is not there, for one writer at a time. Never through a link."""
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    descriptor = os.open(path, flags, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield descriptor
    finally:
        os.close(descriptor)


def _whole(descriptor: int) -> bytes:
    return os.pread(descriptor, os.fstat(descriptor).st_size, 0)


def _add(descriptor: int, before: bytes, line: bytes) -> None:
    """Put the line at the end, on a line of its own also behind one that was cut off, and see that it lasts."""
    data = (b"" if not before or before.endswith(b"\n") else b"\n") + line + b"\n"
    while data:
        data = data[os.write(descriptor, data) :]
    os.fsync(descriptor)
