"""Journals of few rows, written commit by commit, without a recorder."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jbclog.core.rows import TABLES
from jbclog.record.chains import Chain
from jbclog.record.frames import Frame, FrameKind, commit_bytes, mark_bytes
from jbclog.record.row_batches import encode, schema_frame
from jbclog.record.segments import segment_name
from support.records import few_rows

NAME = "20260921T141320Z-bench-k7qd"
Counts = tuple[int, int]
"""Samples and events of a commit."""


@dataclass
class Written:
    """A commit as it stands in its segment. `start` to `end` are its bytes, without its mark."""

    number: int
    segment: int
    start: int
    end: int
    rows: dict[str, list[int]]
    """`seq` of its rows by table."""


@dataclass
class JournalWriter:
    """Writes the segments of a run in `folder`."""

    folder: Path
    commits: list[Written] = field(default_factory=list)
    segment: int = -1
    samples: int = 0
    events: int = 0

    def __post_init__(self) -> None:
        self._chain = Chain(self.folder.name)
        self._frames: list[Frame] = []
        self._rows: dict[str, list[int]] = {}

    @property
    def path(self) -> Path:
        return self.folder / segment_name(self.segment)

    def begin_segment(self) -> None:
        self.segment += 1
        schemas = [schema_frame(table, number) for number, table in enumerate(TABLES)]
        notes = f'{{"run": "{self.folder.name}", "schema": 2, "dropped": 0, "closed": false}}'
        facts = (
            f'{{"a": {{"name": "a", "url": "a.pty", "family": "dde", "skipped": {self.segment}}}}}'
        )
        self._append(
            [
                *schemas,
                Frame.of(FrameKind.NOTES, notes.encode()),
                Frame.of(FrameKind.FACTS, facts.encode()),
            ],
            {},
        )

    def commit(self, counts: Counts) -> None:
        samples, events = counts
        rows = {
            "samples": [*range(self.samples, self.samples + samples)],
            "events": [*range(self.events, self.events + events)],
        }
        frames = []
        if samples:
            values = [value for seq in rows["samples"] for value in few_rows.sample(seq)]
            frames.append(encode("samples", values, self.samples, 0))
        if events:
            linked: list[object] = []
            for seq in rows["events"]:
                self._chain.link(few_rows.event(seq), linked)
            frames.append(encode("events", linked, self.events, 1))
        self.samples += samples
        self.events += events
        self._frames, self._rows = frames, rows
        self._append(frames or [Frame.of(FrameKind.FACTS, b"{}")], rows)

    def again(self) -> None:
        """Write the last commit once more in a new segment, as after a sync that failed."""
        self.begin_segment()
        self._append(self._frames or [Frame.of(FrameKind.FACTS, b"{}")], self._rows)

    def _append(self, frames: Sequence[Frame], rows: dict[str, list[int]]) -> None:
        number = len(self.commits) + 1
        start = self.path.stat().st_size if self.path.exists() else 0
        data = commit_bytes(number, frames)
        with self.path.open("ab") as file:
            file.write(data + mark_bytes(number, few_rows.T0 + number * 600_000))
        self.commits.append(Written(number, self.segment, start, start + len(data), rows))


def journal(out: Path, segments: Iterable[Sequence[Counts]]) -> JournalWriter:
    """A new run whose segments have these commits."""
    folder = out / NAME
    folder.mkdir()
    writer = JournalWriter(folder)
    for commits in segments:
        writer.begin_segment()
        for counts in commits:
            writer.commit(counts)
    return writer
