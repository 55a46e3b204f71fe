"""One thing that is not as it should be: what, where, and the one step that mends it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """`kind` is a dotted word for programs, the rest for people. `where` is a port, a station, a folder or this machine."""

    kind: str
    where: str
    what: str
    step: str
