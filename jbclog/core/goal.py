"""The number of units or joints at which a run ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

UNITS, JOINTS = "units", "joints"
NOT_COUNTED: Final = "How many there were is not known: the record ends before they were counted."


@dataclass(frozen=True, slots=True)
class Goal:
    """Units or joints a run was to end with, and how many it reached; stored in the manifest.

    `what` is ``units`` or ``joints``. `reached` counts finished units or detected joints of all
    stations; None if not known or before the run's end. `text` is a sentence for people.
    """

    what: str
    wanted: int
    reached: int | None = None
    text: str = NOT_COUNTED

    @property
    def is_met(self) -> bool:
        return self.reached is not None and self.reached >= self.wanted
