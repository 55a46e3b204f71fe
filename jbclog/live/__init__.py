"""Follow a run while it is recorded, from another process, without locks or writes.

Start with `follow`. The states it returns are in `states.py`; `view.py` has the rules for what
counts as known and as normal.
"""

from jbclog.live.follower import Follower, follow
from jbclog.live.states import (
    Condition,
    Counter,
    Coverage,
    Joints,
    NumberedEvent,
    Phase,
    PortState,
    Reading,
    RunState,
    Setting,
    StationState,
    Trace,
)

__all__ = [
    "Condition",
    "Counter",
    "Coverage",
    "Follower",
    "Joints",
    "NumberedEvent",
    "Phase",
    "PortState",
    "Reading",
    "RunState",
    "Setting",
    "StationState",
    "Trace",
    "follow",
]
