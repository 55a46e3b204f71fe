"""One contradiction, misprint or gap of the manuals, and what jbclog makes of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Decision:
    """A row of docs/reference/contradictions.md.

    `reading` is what is sent and how what comes is read, `reason` why, and where nothing of it shows on the wire, why not.
    `quirks` are the ways in which virtual stations play the alternative; the driver takes those, and `met` is what the event
    ``protocol.anomaly`` says the first time, with `number` as its code; empty where a run cannot meet it. `doubtful` marks
    those after which the value itself may not be what it seems, `usual` those that every station of its kind meets, so that
    nobody need be warned. `families` are those that the row is about; none named: all that speak JBC's protocol.
    """

    number: int
    title: str
    reading: str
    reason: str
    quirks: tuple[str, ...] = ()
    met: str = ""
    doubtful: bool = False
    usual: bool = False
    families: tuple[str, ...] = ()

    @property
    def shows_on_the_wire(self) -> bool:
        return bool(self.quirks)
