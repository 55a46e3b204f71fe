"""Annotations of a sealed run: acknowledgements, late serials, tools made safe later.

A sealed record never changes; later facts are lines of `annotations.jsonl`: who, when, what, why.
Each line holds its own SHA-256 and that of the previous line, the first that of the manifest, so a
changed, moved or removed line shows. Removed *last* lines do not show; to prove them, note the
fingerprint that `append` returns. A line cut off by a crash does not count, and the next line
carries its hash.

`vouch` adds a line that names the last `report.json`. It is no annotation and not part of the
fingerprint: a report contains the fingerprint, and would change it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Final

from jbclog.core.chain import Chain, Content, sha256
from jbclog.core.clock import UTC_FORMAT
from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, read_regular
from jbclog.core.json_files import decoder

NAME: Final = "annotations.jsonl"
MANIFEST: Final = "manifest.json"
NOTE: Final = "note"
VOUCHED: Final = "report.written"
REPORT: Final = "report.json"
WHICH: Final = re.compile(rf"{re.escape(REPORT)} SHA-256 ([0-9a-f]{{64}})")
LONGEST: Final = 2000  # characters of a text
WORDS: Final = re.compile(r"[a-z][a-z_]*(\.[a-z][a-z_]*)*")


@dataclass(frozen=True, slots=True)
class Annotation:
    """One line: `time` in ISO 8601 UTC, `kind` dotted like those of events, `prev_sha256` of the
    previous line.
    """

    seq: int
    time: str
    kind: str
    who: str
    what: str
    why: str
    prev_sha256: str


_read_annotation: Final = decoder(Annotation)


@dataclass(frozen=True, slots=True)
class _OfManifest:
    state: object = None


_read_state: Final = decoder(_OfManifest)


@dataclass(frozen=True, slots=True)
class Annotations:
    """The readable annotations of a run, and problems of the file (line, sentence).

    `head`: hash of the last annotation, or of the manifest. `links`: hashes of the manifest and of
    all lines, each with the number of annotations so far. `report`: hash of the last `report.json`,
    if a line vouches for one.
    """

    said: list[Annotation] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)
    head: str = ""
    links: Mapping[str, int] = field(default_factory=dict)
    report: str | None = None

    def complaints(self) -> list[str]:
        """Return the problems of the file, a sentence for each."""
        return [f"{NAME}: line {number} {text}" for number, text in self.wrong]


def append(
    folder: Path, *, who: str, what: str, why: str, kind: str = NOTE, utc_s: float | None = None
) -> str:
    """Add an annotation to a sealed run, synced; return the new fingerprint. Raises RecordError.

    Invisible characters of texts become spaces. `utc_s`: seconds since 1970, default now.
    """
    first = _first_link(folder)
    moment = datetime.now(UTC) if utc_s is None else datetime.fromtimestamp(utc_s, UTC)
    texts = {name: _fit(name, text) for name, text in (("who", who), ("what", what), ("why", why))}
    if not WORDS.fullmatch(kind):
        raise RecordError(f"{kind!r} is no kind of an annotation")

    said = Annotation(0, moment.strftime(UTC_FORMAT), kind, **texts, prev_sha256="")
    try:
        with suppress(FileNotFoundError):
            read_regular(folder / NAME, Kind.ANNOTATIONS)  # refuses a file of too many lines
        ((head, _),) = _chain(folder, first).append(said)
    except OSError as error:
        raise RecordError(
            f"{folder / NAME} cannot be written: {write_failure(error, folder)}"
        ) from error
    return head


def vouch(folder: Path, report_sha256: str) -> None:
    """Record the hash of `report.json`, unless the last such line has it. Raises RecordError."""
    if read(folder).report != report_sha256:
        append(
            folder,
            who="jbclog report",
            what=f"{REPORT} SHA-256 {report_sha256}",
            why="the report was written",
            kind=VOUCHED,
        )


def read(folder: Path, manifest_sha256: str | None = None) -> Annotations:
    """Read the annotations of a sealed run, and where their chain is broken. Raises RecordError.

    `manifest_sha256`: the hash of its manifest, if the caller has just read it.
    """
    first = manifest_sha256 or _first_link(folder)
    try:
        content = _chain(folder, first).read()
    except OSError as error:
        raise RecordError(f"{folder / NAME} cannot be read: {error.strerror or error}") from error
    return _annotations(content, first)


def annotations_in(data: bytes, first: str) -> Annotations:
    """Return the annotations in the bytes of their file; `first` is the hash of the manifest."""
    return _annotations(_chain(Path(), first).content(BytesIO(data)), first)


def _annotations(content: Content[Annotation], first: str) -> Annotations:
    said: list[Annotation] = []
    links = {first: 0}
    head, report = first, None
    for sha256_of_line, entry in content.lines:
        if entry is not None and entry.kind == VOUCHED:
            report = _report_in(entry)
        else:
            head = sha256_of_line
            said += [] if entry is None else [entry]
        links[sha256_of_line] = len(said)
    return Annotations(said, content.wrong, head, links, report)


def _report_in(said: Annotation) -> str:
    """Return the hash that a line vouches for; empty if it names none."""
    which = WHICH.fullmatch(said.what)
    return which[1] if which else ""


def _chain(folder: Path, first: str) -> Chain[Annotation]:
    return Chain(
        folder / NAME,
        Kind.ANNOTATIONS,
        _build,
        what="annotation",
        first=first,
        of_first="the manifest",
    )


def _build(body: bytes) -> Annotation:
    said = _read_annotation(body)
    if not _is_complete(said):
        raise ValueError("it acknowledges nothing")
    return said


def _is_complete(said: Annotation) -> bool:
    """Return True if it has a time, an author, a text and a reason; without them it acknowledges
    nothing. Raises ValueError.
    """
    is_time = datetime.fromisoformat(said.time).strftime(UTC_FORMAT) == said.time
    return is_time and all(text.strip() for text in (said.who, said.what, said.why))


def _fit(name: str, text: str) -> str:
    """Return the text without invisible characters, shortened. Raises RecordError if empty."""
    shown = "".join(sign if sign.isprintable() else " " for sign in text).strip()
    if not shown:
        raise RecordError(f"an annotation says {name}: nothing was given")
    return shown if len(shown) <= LONGEST else shown[: LONGEST - 1] + "…"


def _first_link(folder: Path) -> str:
    """Return the manifest's hash. Raises RecordError if the run is not sealed."""
    try:
        data = read_regular(folder / MANIFEST, Kind.MANIFEST)
        state = _read_state(data).state
    except (OSError, ValueError) as error:
        raise RecordError(f"{folder} has no manifest that can be read") from error
    if state != "sealed":
        raise RecordError(
            f"{folder} is not sealed: what happens now belongs into the record itself"
        )
    return sha256(data)


LATE: Final = "unit.late"  # of a serial given after sealing


def late_serials(folder: Path) -> list[str]:
    """Return the serials added to a run after sealing. Raises RecordError."""
    path = folder / NAME
    try:
        if LATE.encode() not in read_regular(path, Kind.ANNOTATIONS):
            return []
    except FileNotFoundError:
        return []
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from error
    return late_in(read(folder))


def late_in(annotations: Annotations) -> list[str]:
    """Return the serials that annotations add."""
    return [said.what for said in annotations.said if said.kind == LATE]
