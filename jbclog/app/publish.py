"""Publish sealed runs: copy their files, byte for byte, into a tree for every reader of Parquet
(`record/published.py`).

1. What differs from its SHA-256 in the manifest is never published.
2. A key that exists with another length, or a run that was published with another manifest, stops
   the run, and nothing of it is changed.
3. The manifest is written last. Whatever an interrupted publisher left is written again, so the
   result is the same; two publishers of one run write the same bytes.
4. Annotations grow, and what was derived from a run may be made anew: both are replaced, by name.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pyarrow import ArrowException
from pyarrow.parquet import read_metadata

from jbclog.core.chain import sha256
from jbclog.core.errors import RecordError
from jbclog.core.files import MIB, Kind, open_regular, read_regular
from jbclog.core.rows import SCHEMA_VERSION
from jbclog.core.text import count_text
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import read as read_annotations
from jbclog.record.chains import short_head
from jbclog.record.conclude import sealed_file
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import Manifest, SealedFile, read_manifest
from jbclog.record.published import MADE_LATER, Stored, Tree, explained, key_of
from jbclog.record.sealed_files import expect_manifest_unchanged

NOTHING: Final = "; nothing was published"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What publishing a run did: `files` copied with their `bytes`; none if it was there already.
    `refused` has the reason why it was not published.
    """

    run: str
    folder: str
    files: int = 0
    bytes: int = 0
    refused: str | None = None

    def __str__(self) -> str:
        if self.refused is not None:
            return f"{self.run}: {self.refused.removeprefix(f'{self.run}: ')}"
        if not self.files:
            return f"{self.run}: published before"
        return f"{self.run}: {count_text(self.files, 'file')}, {self.bytes / 1e6:.1f} MB"


def publish(folder: Path, tree: Tree) -> Outcome:
    """Publish a sealed run. Raises `RecordError`."""
    run = _Run(folder, tree)
    run.expect_same_manifest()
    missing = run.missing()
    for file in missing:
        run.expect_unchanged(file)
    newer = [*run.newer()]
    for file in missing:
        tree.put(key_of(run.name, file.path), _pieces(folder / file.path, file.sha256))
    for name in newer:
        tree.put(key_of(run.name, name), _pieces(folder / name))
    if run.theirs is None:
        tree.put(key_of(run.name, MANIFEST), [run.data])
    copied = [folder / name for name in (*(file.path for file in missing), *newer)]
    copied += [folder / MANIFEST] * (run.theirs is None)
    size = sum(path.stat().st_size for path in copied)
    return Outcome(run.name, str(folder), len(copied), size)


def try_publish(folder: Path, tree: Tree) -> Outcome:
    """Publish a sealed run; an error is the outcome's reason."""
    try:
        return publish(folder, tree)
    except RecordError as error:
        return Outcome(folder.name, str(folder), refused=str(error))


def differences(folder: Path, tree: Tree) -> list[str]:
    """Return a sentence for each difference between a sealed run and what is published of it. In a
    folder contents are compared, in S3 lengths, and the manifest.
    """
    found: list[str] = []
    try:
        found.extend(_differences(_Run(folder, tree)))
    except RecordError as error:
        found.append(str(error))
    return found


def _differences(run: _Run) -> Iterator[str]:
    tree = run.tree
    if run.theirs is None:
        yield f"{run.name}: is not published"
        return
    run.expect_same_manifest()
    for file in run.manifest.files:
        key = key_of(run.name, file.path)
        there = run.stored.get(key)
        if there is None:
            yield f"{key} is missing"
        elif there.size != file.bytes:
            yield f"{key} has {there.size} bytes, the manifest says {file.bytes}"
        elif not tree.is_remote and _sha256_of(tree, key) != file.sha256:
            yield f"{key} was changed: its SHA-256 is not the manifest's"
    for name in run.newer():
        yield f"{key_of(run.name, name)} is missing, or older than {name} in {run.folder}"


class _Run:
    """A sealed run and what is published of it. Methods raise `RecordError`."""

    def __init__(self, folder: Path, tree: Tree) -> None:
        self.folder, self.tree = folder, tree
        self.manifest: Manifest = read_manifest(folder)
        if not self.manifest.is_sealed:
            raise RecordError(
                f"{folder}: is not sealed: it is being recorded, or it crashed; then run `jbclog"
                f" recover`{NOTHING}"
            )
        if self.manifest.schema < SCHEMA_VERSION:
            raise RecordError(
                f"{folder}: has the tables of schema {self.manifest.schema}, whose columns have"
                f" other names, and readers of the plant's tables would stop{NOTHING}; read the run"
                " from its folder"
            )
        expect_manifest_unchanged(folder)
        self.data = _content(folder / MANIFEST, Kind.MANIFEST)
        self.name = self.manifest.run
        names = (*(file.path for file in self.manifest.files), *MADE_LATER)
        self.theirs = tree.read(key_of(self.name, MANIFEST))
        self.stored: dict[str, Stored] = tree.stored(key_of(self.name, name) for name in names)

    def expect_same_manifest(self) -> None:
        """Raise `RecordError` if the run was published with another manifest."""
        if self.theirs not in (None, self.data):
            raise RecordError(
                f"{self.name}: {self.tree} has this run with another manifest (fingerprint"
                f" {short_head(sha256(self.theirs or b''))}, here {short_head(sha256(self.data))})"
                f"{NOTHING}. `jbclog check` shows which copy was changed"
            )

    def missing(self) -> list[SealedFile]:
        """Return the files to copy: those that are missing, and all if the run is not published
        yet. Raises `RecordError` if a key has another length.
        """
        for file in self.manifest.files:
            key = key_of(self.name, file.path)
            size = self.stored[key].size if key in self.stored else file.bytes
            if size != file.bytes:
                raise RecordError(
                    f"{self.name}: {self.tree}/{key} has {size} bytes, the manifest says"
                    f" {file.bytes}{NOTHING}. Remove the file there if it is not of this run"
                )
        return [
            file
            for file in self.manifest.files
            if self.theirs is None or key_of(self.name, file.path) not in self.stored
        ]

    def expect_unchanged(self, file: SealedFile) -> None:
        """Raise `RecordError` if a file is not the sealed one."""
        try:
            found = sealed_file(self.folder, self.folder / file.path, None).sha256
        except OSError as error:
            raise RecordError(
                f"{self.name}: {file.path} cannot be read: {error.strerror or error}{NOTHING}"
            ) from error
        if found != file.sha256:
            raise RecordError(
                f"{self.name}: {file.path} was changed: its SHA-256 is {found}, the manifest says"
                f" {file.sha256}{NOTHING}. `jbclog check` lists all findings"
            )

    def newer(self) -> Iterator[str]:
        """Yield the files made after sealing that are not published, or older there."""
        if self._has_new_annotations():
            yield ANNOTATIONS
        for name in MADE_LATER:
            path, there = self.folder / name, self.stored.get(key_of(self.name, name))
            if not path.is_file() or path.is_symlink() or not _is_whole(path):
                continue
            here = path.stat()
            # S3 gives whole seconds
            if there is None or here.st_size != there.size or int(here.st_mtime) > there.written_s:
                yield name

    def _has_new_annotations(self) -> bool:
        if not (self.folder / ANNOTATIONS).exists():
            return False
        wrong = read_annotations(self.folder).complaints()
        if wrong:
            raise RecordError(f"{self.name}: {wrong[0]}{NOTHING}. `jbclog check` lists all")
        ours = _content(self.folder / ANNOTATIONS, Kind.ANNOTATIONS)
        theirs = self.tree.read(key_of(self.name, ANNOTATIONS)) or b""
        if not (ours.startswith(theirs) or theirs.startswith(ours)):
            raise RecordError(
                f"{self.name}: this copy and the one in {self.tree} were annotated differently"
                f"{NOTHING}. Annotate only one copy of a run"
            )
        return len(ours) > len(theirs)


def _content(path: Path, kind: Kind) -> bytes:
    try:
        return read_regular(path, kind)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from error


def _sha256_of(tree: Tree, key: str) -> str:
    with explained(tree), Path(tree.url, key).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _pieces(path: Path, expected: str | None = None) -> Iterator[bytes]:
    """Yield the content of a file. Raises `RecordError` at its end if it is not the one whose
    SHA-256 is `expected`: somebody wrote to it meanwhile.
    """
    digest = hashlib.sha256()
    with open_regular(path, Kind.RECORD) as file:
        while piece := file.read(MIB):
            digest.update(piece)
            yield piece
    if expected is not None and digest.hexdigest() != expected:
        raise RecordError(f"{path} changed while it was published")


def _is_whole(path: Path) -> bool:
    """Return whether a derived file can be read: a damaged one would stop every reader of the
    plant's table, and `jbclog report` makes it anew.
    """
    if path.suffix != ".parquet":
        return True
    try:
        read_metadata(path)
    except (ArrowException, OSError):
        return False
    return True
