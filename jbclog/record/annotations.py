"""What was said of a run after sealing, and which units were on the bench by it.

Acknowledgements, late serials, tools that were made safe later. The record itself never changes once it is sealed, so
what is said of it later stands here: who, when, what, why. Each line holds the SHA-256 of the line before it, the first
one that of the manifest (the head), and its own: a line changed, moved or taken out from between shows. That the
*last* lines are gone does not show: whoever must be able to prove them notes the head that `append` gives.

A report is vouched for here, too: whoever writes one says which `report.json` it is (`vouch`). Such a line is no saying and no
head: a report names the head of what was said, and would otherwise move what it names.

A line that a crash cut off was never acknowledged. It is told, counts for nothing, and keeps nobody from going on: the
next line is put behind it and vouches for it.

    append(folder, who="jbclog guard", what="dde-1 port 1: stand", why="its recorder was killed", kind="safety.safe_state")

Loads nothing heavy, so that a guard and a safe verb can write here too.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.durable_files import add_line, chain_in, fields_of, first_faults, line_of, lines_in, sha256
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.foreign.json_reader import build, json_of
from jbclog.record.manifest import Unit, iso
from jbclog.record.parts import row_groups

# -- annotations --------------------------------------------------------------------------------------------------------------

NAME: Final = "annotations.jsonl"
MANIFEST: Final = "manifest.json"
NOTE: Final = "note"
TIME: Final = "%Y-%m-%dT%H:%M:%S.%fZ"
VOUCHED: Final = "report.written"
REPORT: Final = "report.json"
WHICH: Final = re.compile(rf"{re.escape(REPORT)} SHA-256 ([0-9a-f]{{64}})")
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

    `head` is the hash of the last line that says something, of the manifest where there is none. `links` are the hashes of all
    lines, and of the manifest. `report` is the hash of the `report.json` that was written last; None where no line vouches for one.
    """

    said: list[Annotation] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)
    head: str = ""
    links: frozenset[str] = frozenset()
    report: str | None = None

    def complaints(self) -> list[str]:
        """What is wrong with the file, a sentence each."""
        return [f"{NAME}: line {number} {text}" for number, text in self.wrong]


def append(folder: Path, *, who: str, what: str, why: str, kind: str = NOTE, utc_s: float | None = None) -> str:
    """Say something of the sealed run in `folder`; give the new head, when it is on the disk. Raises `RecordError`.

    Texts are kept without what does not show. `utc_s` is the moment in seconds since 1970, now where it is not given.
    """
    first = _first_link(folder)
    moment = datetime.now(UTC) if utc_s is None else datetime.fromtimestamp(utc_s, UTC)
    texts = {name: _fit(name, text) for name, text in (("who", who), ("what", what), ("why", why))}
    if not WORDS.fullmatch(kind):
        raise RecordError(f"{kind!r} is no kind of an annotation")

    def made(seq: int, previous: str) -> bytes:
        time = moment.strftime(TIME)
        return line_of(asdict(Annotation(seq, time, kind, texts["who"], texts["what"], texts["why"], previous)))

    try:
        with suppress(FileNotFoundError):
            read_foreign(folder / NAME, Kind.ANNOTATIONS)  # which refuses what nobody has time to read
        return add_line(folder / NAME, first, _parsed, made)
    except OSError as error:
        raise RecordError(f"{folder / NAME} cannot be written: {error.strerror or error}") from error


def vouch(folder: Path, report_sha256: str) -> None:
    """Say which `report.json` is that of the sealed run in `folder`, unless the last such line says so. Raises `RecordError`."""
    if read(folder).report != report_sha256:
        append(folder, who="jbclog report", what=f"{REPORT} SHA-256 {report_sha256}", why="the report was written", kind=VOUCHED)


def read(folder: Path) -> Annotations:
    """Everything that was said of the run in `folder`, and where its chain does not hold. Raises `RecordError`."""
    first = _first_link(folder)
    try:
        data = read_foreign(folder / NAME, Kind.ANNOTATIONS)
    except FileNotFoundError:
        return Annotations(head=first, links=frozenset({first}))
    except OSError as error:
        raise RecordError(f"{folder / NAME} cannot be read: {error.strerror or error}") from error
    found = chain_in(data, first, _parsed, what="annotation", of_first="the manifest")
    lines = lines_in(data)
    vouching = {link for said, link in zip(found.entries, found.hashes, strict=True) if said.kind == VOUCHED}
    links = [sha256(line) for line in lines]
    return Annotations(
        [said for said in found.entries if said.kind != VOUCHED],
        first_faults(found.wrong),
        next((link for link in reversed(links) if link not in vouching), first),
        frozenset({first, *links}),
        next((_report_in(said) for said in reversed(found.entries) if said.kind == VOUCHED), None),
    )


def _report_in(said: Annotation) -> str:
    """The hash that a line vouches for; nothing, which is no report's, where it names none."""
    which = WHICH.fullmatch(said.what)
    return which[1] if which else ""


def _parsed(line: bytes) -> Annotation | None:
    """The annotation in a line; None where it is not, to the byte, what `append` would have written."""
    try:
        said = build(Annotation, fields_of(line))
        return said if _says_all(said) and line_of(asdict(said)) == line else None
    except ValueError:
        return None


def _says_all(said: Annotation) -> bool:
    """Whether somebody says something, why, and when: what nobody said, with no reason, acknowledges nothing. Raises ValueError."""
    is_time = datetime.fromisoformat(said.time).strftime(TIME) == said.time
    return is_time and all(text.strip() for text in (said.who, said.what, said.why))


def _fit(name: str, text: str) -> str:
    """Without what does not show, and not too long. Raises `RecordError` where nothing is left."""
    shown = "".join(sign if sign.isprintable() else " " for sign in text).strip()
    if not shown:
        raise RecordError(f"an annotation says {name}: nothing was given")
    return shown if len(shown) <= LONGEST else shown[: LONGEST - 1] + "…"


def _first_link(folder: Path) -> str:
    """The manifest's hash. Raises `RecordError` where the run is not sealed."""
    try:
        data = read_foreign(folder / MANIFEST, Kind.MANIFEST)
        state = json_of(data).get("state")
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise RecordError(f"{folder} has no manifest that can be read") from error
    if state != "sealed":
        raise RecordError(f"{folder} is not sealed: what happens now belongs into the record itself")
    return sha256(data)


# -- units --------------------------------------------------------------------------------------------------------------------
# Which units were on the bench when, as the events of a run tell it, and whose joints are whose.
#
# A unit lasts from its `unit.begin` to its `unit.end`, or to the begin of the next. One that a crash cut off has no end. A serial
# that is told after sealing is an annotation of the kind `unit.late`.
#
# A joint belongs to the unit that was on the bench then. Where no serial was read while the run went on, all of it belongs to the
# unit that was named at the start or later, if that is one; to none that is known, if they are several.

BEGIN, END, LATE = "unit.begin", "unit.end", "unit.late"
COLUMNS: Final = ["time", "kind", "raw"]


def units_of(folder: Path) -> list[Unit]:
    """The units of the run in `folder`, from its sealed events."""
    found: list[Unit] = []
    for group in row_groups(folder, "events", COLUMNS):
        told = group.filter(pc.is_in(group["kind"], pa.array([BEGIN, END])))
        for micros, kind, raw in zip(*(column.to_pylist() for column in _plain(told)), strict=True):
            if found and found[-1].end is None:
                found[-1] = replace(found[-1], end=iso(micros))
            if kind == BEGIN:
                found.append(Unit(raw or "", iso(micros)))
    return found


def late_serials(folder: Path) -> list[str]:
    """The serials that were told of the sealed run in `folder` later. Raises `RecordError`."""
    if not (folder / NAME).exists():
        return []
    return [said.what for said in read(folder).said if said.kind == LATE]


def only_unit(named: Sequence[str], late: Sequence[str]) -> str | None:
    """The unit of a run in which no serial was read: the one that people named, None where they named none, or several."""
    serials = {*named, *late}
    return serials.pop() if len(serials) == 1 else None


def _plain(told: pa.Table) -> list[pa.ChunkedArray]:
    return [told["time"].cast(pa.int64()), told["kind"], told["raw"]]
