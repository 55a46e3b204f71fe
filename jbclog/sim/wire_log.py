"""What a virtual station remembers of the wire, for tests: never what the client believes it sent."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from jbclog.core.quantities import Value


class Written(NamedTuple):
    """A write that the station accepted; `at` in monotonic seconds, `port` and `tool` 0 where it has none."""

    at: float
    name: str
    port: int
    tool: int
    value: Value


class Refused(NamedTuple):
    """A question that the station refused with communication error `code`."""

    at: float
    text: str
    code: int


class Struck(NamedTuple):
    """An answer that a fault has struck: what would have gone out, and what did."""

    at: float
    kind: str
    clean: bytes
    sent: bytes


@dataclass(slots=True)
class WireLog:
    """In the order in which it happened. `reads` counts those that were answered."""

    reads: int = 0
    writes: list[Written] = field(default_factory=list)
    refused: list[Refused] = field(default_factory=list)
    struck: list[Struck] = field(default_factory=list)

    def written(self, name: str) -> list[Written]:
        """The accepted writes of one command."""
        return [write for write in self.writes if write.name == name]
