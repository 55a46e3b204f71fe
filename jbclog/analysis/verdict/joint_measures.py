"""What is put before the judge of the joints of a port: how long each recovery took, and what the feeder counted meanwhile.

The joints are found from the samples, by whoever calls the judge (`analysis.joints`); what a joint is stands there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Recovery:
    """Of one joint: the time in s until the tip was back, or, where it was not seen back, the time that it had.

    `back` is True where it was back before the next joint, False where the next joint came first, None where the record, the tool's
    work or the setpoint ended before that.
    """

    seconds: float
    back: bool | None


@dataclass(frozen=True, slots=True)
class Feeds:
    """Joints found and feeds counted (R-DC) between two readings of the feeder's counter.

    `at_edges` of the `found` lie so close to one of these readings that it cannot be told on which side they are; `beyond`
    are those that lie so outside. `lost_s`: for how long there was a gap, in which no joint can be found. `counted` is None
    where the counter tells nothing, and then `why` says so.
    """

    found: int
    at_edges: int
    beyond: int
    counted: int | None
    lost_s: float = 0.0
    why: str = ""


@dataclass(frozen=True, slots=True)
class PortJoints:
    """The joints of one port, in their order: the recovery of each, None where it is not known.

    `feeds` is None for a tool without a feeder. `why` says that joints, or some of them, are not known, and why. `hidden`: how many
    more there may be in the `unseen_s` seconds of work that were not read.
    """

    recoveries: Sequence[Recovery | None] = ()
    feeds: Feeds | None = None
    why: str | None = None
    hidden: int = 0
    unseen_s: float = 0.0


def not_read(seconds: float) -> str:
    """That there may be joints that nobody could see, as a sentence."""
    return f"Joints in gaps ({seconds:.1f} s) are not known."


Joints = Mapping[tuple[str, int], PortJoints]
"""By station and port."""
