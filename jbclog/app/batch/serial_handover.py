"""The serial that ends one job is that of the next one's first unit: who made the fortieth put away has the next one in hand."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from jbclog.app.batch.job_dir import JobDir
from jbclog.transport.typed_lines import Source

NEXT: Final = "unit.next"
FEED: Final = (
    *("unit.begin", "unit.end", "unit.again", "unit.repeated", "unit.finish", "unit.refused", "unit.closed", "unit.lost"),
    NEXT,
)


class Carried(Source):
    """A source that first gives a serial which was read from it before."""

    def __init__(self, source: Source, serial: str) -> None:
        self.name = source.name
        self.is_typed = source.is_typed
        self._source = source
        self._first: bytes | None = serial.encode() + b"\n"

    def read(self) -> bytes | None:
        first, self._first = self._first, None
        return first if first is not None else self._source.read()

    def close(self) -> None:
        self._source.close()


def carried(before: Iterable[JobDir]) -> str | None:
    """The serial that the last of these jobs read and left to the next; None where there is none, or it is not known."""
    ended = [papers for papers in before if papers.ended_at() is not None]
    last = max(ended, key=lambda papers: papers.ended_at() or 0.0, default=None)
    events = [] if last is None else [event for event in last.events(0)[0] if event.kind in FEED]
    return events[-1].raw if events and events[-1].kind == NEXT else None
