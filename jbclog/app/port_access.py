"""How a command outside of a run opens ports and measures time: the system's, or that of virtual
stations.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final, TypeVar

from jbclog.core.clock import Clock, SystemClock
from jbclog.core.io_requests import Steps
from jbclog.core.serial_line import LineFormat
from jbclog.transport import blocking
from jbclog.transport.opening import open_port
from jbclog.transport.port import Port

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class PortAccess:
    """Opens ports, waits and reads the clock."""

    open_port: Callable[[str, LineFormat], Port]
    sleep: Callable[[float], None]
    clock: Clock

    def run(self, steps: Steps[T], opened: Callable[[], Port]) -> T:
        """Run `steps` on the port that `opened` returns; return their result."""
        return blocking.run(steps, opened, sleep=self.sleep, clock=self.clock)

    def now(self) -> datetime:
        """Return the current time in UTC."""
        return datetime.fromtimestamp(self.clock.utc(), UTC)

    def utc_of(self, moment: float) -> datetime:
        """Convert a monotonic time of this process to UTC."""
        return datetime.fromtimestamp(self.clock.utc() - self.clock.monotonic() + moment, UTC)


SYSTEM: Final = PortAccess(open_port, time.sleep, SystemClock())
