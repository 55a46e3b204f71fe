"""Identifies the run in a folder, and decides whether a store has it already.

The manifest identifies a run: the same name with another manifest is another run, and refused. A
run changes later only by annotations, which form a chain that begins with the manifest. Of two
copies, the one whose chain continues the other's is newer. Copies that were annotated differently
on two computers are refused, because neither is newer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import Enum, auto
from pathlib import Path

from jbclog.analysis.store.plain_files import is_name
from jbclog.analysis.verdict import RULES
from jbclog.core.durable_files import line_of, sha256
from jbclog.core.errors import RecordError
from jbclog.record.annotations import read as read_annotations
from jbclog.record.chains import short_head
from jbclog.record.manifest import manifest_sha256, read_manifest


class Step(Enum):
    """What a store lacks of a run; `OLDER`: nothing, it has a newer version."""

    ALL = auto()
    FINDINGS = auto()
    NOTHING = auto()
    OLDER = auto()


@dataclass(frozen=True, slots=True)
class Identity:
    """A run and its version: SHA-256 of the manifest and of each annotation, oldest first, and the
    version of the rules for its figures.
    """

    run: str
    manifest_sha256: str
    annotations: tuple[str, ...]
    rules: int = RULES

    def step(self, known: Identity | None) -> Step:
        """Return what a store lacks of this run. `known`: the store's version of it, None if it has
        none. Raises `RecordError` if the two contradict each other.
        """
        if known is None:
            return Step.ALL
        if known.manifest_sha256 != self.manifest_sha256:
            raise RecordError(
                f"{self.run}: the store has this run with another manifest"
                f" ({short_head(known.manifest_sha256)}, here {short_head(self.manifest_sha256)});"
                " nothing was published. `jbclog check` shows which folder was changed"
            )
        if _starts_with(self.annotations, known.annotations):
            grown = len(self.annotations) > len(known.annotations)
            return Step.FINDINGS if grown or self.rules > known.rules else Step.NOTHING
        if _starts_with(known.annotations, self.annotations):
            return Step.OLDER
        raise RecordError(
            f"{self.run}: this copy and the one in the store were annotated differently; nothing"
            " was published. Annotate only one copy of a run"
        )


def _starts_with(whole: Sequence[str], part: Sequence[str]) -> bool:
    return tuple(whole[: len(part)]) == tuple(part)


def identity_of(folder: Path) -> Identity:
    """Return the identity of the sealed run in `folder`. Raises `RecordError` if it is not sealed,
    or if its name or its annotations are damaged.
    """
    manifest = read_manifest(folder)
    if not manifest.is_sealed:
        raise RecordError(
            f"{folder} is not sealed: it is being recorded, or it crashed; then run `jbclog"
            " recover`"
        )
    if not is_name(manifest.run):
        raise RecordError(
            f"{folder}: its manifest names the run {manifest.run!r:.100}, as no run is named;"
            " nothing was published"
        )
    annotations = read_annotations(folder)
    if annotations.wrong:
        raise RecordError(
            f"{folder}: {annotations.complaints()[0]}; nothing was published. `jbclog check` lists"
            " all findings"
        )
    # `said` leaves out the lines that name a report
    hashes = tuple(sha256(line_of(asdict(one))) for one in annotations.said)
    return Identity(manifest.run, manifest_sha256(folder), hashes)
