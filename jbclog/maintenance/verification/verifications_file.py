"""The file of verifications: `verifications.jsonl` in the folder of runs (`--out`), a line of JSON each, only ever added to.

It lies there because that is what its runs are looked for in, and what a line's recorders share. Each line holds the SHA-256 of
the one before it, the first one that of the file's name, and its own (`core/durable_files.py`). Each run carries the hash of the
lines that it stands on in its manifest, so that a line that is taken off the end shows by the runs.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final, cast

from jbclog.core.durable_files import add_line, chain_in, fields_of, line_of, sha256, sync_folder
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.foreign.json_reader import Misfit, build
from jbclog.maintenance.verification.verification import Verification

NAME: Final = "verifications.jsonl"
FIRST: Final = sha256(NAME.encode())
LONGEST: Final = 2000


@dataclass(frozen=True, slots=True)
class Book:
    """Every verification that can be read, oldest first, with the hashes of their lines; what is wrong (line, sentence)."""

    all: list[Verification] = field(default_factory=list)
    hashes: list[str] = field(default_factory=list)
    wrong: list[tuple[int, str]] = field(default_factory=list)
    head: str = FIRST

    def hash_of(self, one: Verification) -> str:
        return self.hashes[self.all.index(one)]


def keep(out: Path, one: Verification) -> tuple[Verification, str]:
    """Put it at the end of the file in `out`; give it as it stands there, and the new head. Raises `RecordError`.

    A file whose chain does not hold is not written to: `where-used` and this verb say what is wrong with it.
    """
    found = read_book(out)
    if any("cut off" not in text for _, text in found.wrong):
        number, text = found.wrong[0]
        raise RecordError(f"{out / NAME}: line {number} {text}; nothing is added to it. Put it right from a copy, or set it aside")
    kept: list[Verification] = []

    def made(seq: int, previous: str) -> bytes:
        kept.append(replace(one, seq=seq, prev_sha256=previous))
        return line_of(asdict(kept[0]))

    try:
        if not out.is_dir():
            out.mkdir(parents=True)
            sync_folder(out.absolute().parent)
        head = add_line(out / NAME, FIRST, _parsed, made)
    except OSError as error:
        raise RecordError(f"{out / NAME} cannot be written: {error.strerror or error}") from error
    return kept[0], head


def read_book(out: Path) -> Book:
    """Every verification in the folder of runs `out`; none where there is no file. Raises `RecordError`."""
    try:
        found = chain_in(
            read_foreign(out / NAME, Kind.VERIFICATIONS), FIRST, _parsed, what="verification", of_first="the file's name"
        )
    except FileNotFoundError:
        return Book()
    except OSError as error:
        raise RecordError(f"{out / NAME} cannot be read: {error.strerror or error}") from error
    return Book(found.said, found.hashes, found.wrong, found.head)


def _parsed(line: bytes) -> Verification | None:
    try:
        said = cast(Verification, build(Verification, fields_of(line)))
        return said if line_of(asdict(said)) == line else None
    except (ValueError, TypeError, AttributeError, KeyError, RecursionError, Misfit):
        return None
