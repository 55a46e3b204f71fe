"""Hash chains: of a run's events, and of the runs on a production line."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, read_regular
from jbclog.core.rows import SCHEMA_VERSION, EventRow
from jbclog.core.text import count_text
from jbclog.record.folder import LETTERS, RUN_NAME
from jbclog.record.manifest import (
    NAME,
    Manifest,
    Previous,
    manifest_sha256,
    read_manifest,
)
from jbclog.record.old_names import OLD_COLUMNS, OLD_SCHEMA
from jbclog.record.schema import RUN, SCHEMAS

# Each event holds the SHA-256 of the previous event, the first one that of the run's name. A
# changed, removed or inserted event breaks the chain there. A missing end shows by the hash of the
# file in the manifest. An event is hashed with the names of its run's schema, and without `run`.

COLUMNS: Final = tuple(name for name in SCHEMAS["events"].names if name != RUN)
FIRST: Final = {OLD_SCHEMA: 1, SCHEMA_VERSION: 0}
"""Number of the first event, by schema."""
_OLD_NAMES: Final = {now: name for name, now in OLD_COLUMNS["events"].items()}


def first_link(run: str) -> str:
    """Return `prev_sha256` of the first event of `run`."""
    return hashlib.sha256(run.encode()).hexdigest()


def digest(row: Mapping[str, object], schema: int = SCHEMA_VERSION) -> str:
    """Return the SHA-256 of an event as canonical JSON: all columns but `run` by their names in
    `schema`, times in µs, keys sorted, no blanks.
    """
    names = _OLD_NAMES if schema == OLD_SCHEMA else {}
    hashed = {names.get(name, name): value for name, value in row.items() if name != RUN}
    return hashlib.sha256(
        json.dumps(hashed, sort_keys=True, separators=(",", ":")).encode()
    ).hexdigest()


class Chain:
    """Numbers and links the events of a run in order."""

    def __init__(self, run: str, schema: int = SCHEMA_VERSION) -> None:
        self._schema = schema
        self._next = FIRST[schema]
        self._previous = first_link(run)

    @classmethod
    def after(cls, row: Mapping[str, object], schema: int) -> Chain:
        """Continue a chain after its last `row` (times in µs)."""
        chain = cls("", schema)
        seq = row["seq"]
        assert isinstance(seq, int)
        chain._next, chain._previous = seq + 1, digest(row, schema)
        return chain

    def skip(self) -> None:
        """Leave the next number to an event that is lost."""
        self._next += 1

    def link(self, event: EventRow, rows: list[object]) -> None:
        """Append the row of `event` to `rows`, in the columns' order, and link it.

        Raises ValueError or TypeError for an invalid event, before linking it.
        """
        row = {
            "seq": self._next,
            "time": int(event.time),
            "earliest": _whole(event.earliest),
            "station": event.station,
            "port": _whole(event.port),
            "kind": event.kind,
            "severity": str(event.severity),
            "code": _whole(event.code),
            "text": event.text,
            "value": None if event.value is None else float(event.value),
            "limit_value": _fraction(event.limit_value),
            "raw": event.raw,
            "prev_sha256": self._previous,
        }
        previous, following = digest(row, self._schema), self._next + 1
        rows.extend([row[column] for column in COLUMNS])
        self._next, self._previous = following, previous


def breaks(
    run: str,
    rows: Iterable[Mapping[str, object]],
    schema: int = SCHEMA_VERSION,
    *,
    is_whole: bool = True,
) -> Iterable[tuple[int, str]]:
    """Yield the breaks in the chain of `rows` (times in µs) of a run of `schema`: the event's seq,
    and what is wrong. Events missing from a record that is not whole are no break.
    """
    previous, seq = first_link(run), FIRST[schema] - 1
    before = "the start"
    for row in rows:
        found = row["seq"]
        number = found if isinstance(found, int) else -1
        if number > seq + 1 and not is_whole:
            pass  # the manifest has the loss
        elif number != seq + 1:
            yield (
                number,
                (
                    f"follows {before}; {count_text(number - seq - 1, 'event')} missing"
                    if number > seq
                    else f"stands after {before}"
                ),
            )
        elif row["prev_sha256"] != previous:
            yield (
                number,
                "does not carry the hash of the event before it: one of the two was changed",
            )
        previous, seq, before = digest(row, schema), number, f"event {number}"


def _whole(value: int | None) -> int | None:
    return None if value is None else int(value)


def _fraction(value: float | None) -> float | None:
    return None if value is None else float(value)


# A manifest carries the fingerprint of the previous run on the same production line: the SHA-256 of
# its manifest, which contains those of its files. A folder rewritten as a whole, hashes included,
# shows only by copies elsewhere: on a printed report, in the next manifest.
#
# The same production line means the same name in the same folder of runs (`--out`). The previous
# run is the newest sealed one by its folder's name, which begins with its start; open runs and
# unreadable manifests are skipped.

# hex digits of the short form: 96 bits, too many for a second record with the same
SHOWN: Final = 24
LEAST: Final = 16  # digits in reports of 0.1.0
HEAD: Final = re.compile(r"(?:[0-9a-fA-F]{4}[ -]?){4,16}")


def short_head(sha256: str) -> str:
    """Return the short form for people to compare: ``3f2a-91bc-77de-0a12-5c08-b6e1``."""
    return "-".join(sha256[place : place + 4] for place in range(0, SHOWN, 4))


def is_head(typed: str, sha256: str) -> bool:
    """Return True if `typed`, in short or full form, matches this fingerprint."""
    plain = re.sub(r"[\s-]", "", typed).lower()
    return len(plain) >= LEAST and sha256.startswith(plain)


def digits(typed: str) -> int:
    """Return the number of hex digits typed."""
    return len(re.sub(r"[\s-]", "", typed))


def previous_run(out: Path, line: str, own: Path | None = None) -> Previous:
    """Return the previous run for a new run of `line` below `out`, or for the one in the folder
    `own`.
    """
    others = [name for name in _runs_of(out, line) if own is None or name != own.name]
    for folder in (out / name for name in reversed(others)):
        with suppress(RecordError, OSError):
            if read_manifest(folder).is_sealed:
                return Previous(
                    folder.name, manifest_sha256(folder), f"The run before this one on line {line}."
                )
    if others:
        return Previous(
            None, None, f"No run of line {line} in this folder was sealed when this one began."
        )
    return Previous(None, None, f"The first run of line {line} in this folder.")


def _runs_of(out: Path, line: str) -> list[str]:
    """Return the names of the line's runs below `out`, oldest first. A start waits for this: there
    may be ten thousand.
    """
    name = re.compile(rf"\d{{8}}T\d{{6}}Z-{re.escape(line)}-[{LETTERS}]{{4}}")
    # creating a run reports whether the folder is usable
    with suppress(OSError), os.scandir(out) as entries:
        return sorted(one.name for one in entries if name.fullmatch(one.name) and _is_folder(one))
    return []


def _is_folder(entry: os.DirEntry[str]) -> bool:
    with suppress(OSError):
        return entry.is_dir(follow_symlinks=False)
    return False


def broken_links(folder: Path, manifest: Manifest) -> Iterator[str]:
    """Yield disagreements of this run and its neighbours in the folder; skip missing ones."""
    folder = folder.absolute()
    yield from _before(folder, manifest)
    yield from _behind(folder, manifest)


def _before(folder: Path, manifest: Manifest) -> Iterator[str]:
    carried = manifest.previous
    if carried is None or carried.run is None:
        return
    if not RUN_NAME.fullmatch(carried.run):
        yield f"previous: {carried.run!r:.80} is no run's name"
        return
    found = _head_of(folder.parent / carried.run)
    if found is not None and found != carried.sha256:
        yield (
            f"previous: {carried.run} is not what it was when this run began: its head is"
            f" {short_head(found)}, " + _carried(carried)
        )


def _behind(folder: Path, manifest: Manifest) -> Iterator[str]:
    if manifest.line is None or folder.name != manifest.run:
        return
    own = manifest_sha256(folder)
    for path in (folder.parent / name for name in _runs_of(folder.parent, manifest.line.name)):
        with suppress(RecordError, OSError):
            if path.name == folder.name or manifest.run.encode() not in read_regular(
                path / NAME, Kind.MANIFEST
            ):
                continue
            carried = read_manifest(path).previous
            if carried is not None and carried.run == manifest.run and carried.sha256 != own:
                yield (
                    f"was changed after {path.name} began: its head is {short_head(own)}, "
                    + _carried(carried)
                )


def _carried(carried: Previous) -> str:
    return f"carried is {short_head(carried.sha256 or 'none')}"


def _head_of(folder: Path) -> str | None:
    """Return the fingerprint of a run; None if it is missing."""
    try:
        return manifest_sha256(folder)
    except RecordError:
        return None
