"""jbclog on a host whose clocks do as they like:
``python tests/support faults.odd_host STEPS run ...``.

STEPS are words with commas between them. ``at=SECONDS`` is what the wall clock says when it is
first looked at. Each SIGUSR1 takes the next of the others: ``step=SECONDS`` steps the wall clock,
as an operator or a time server would, ``sleep=SECONDS`` suspends the machine for so long: both
clocks go on, and nothing else did. Nothing of this is in the product: what it calls is patched.
"""

from __future__ import annotations

import signal
import sys
import time

from support.product import elapsed, put

real_elapsed = elapsed


class OddClocks:
    """How far this host's clocks are from the real ones, in seconds."""

    def __init__(self, steps: str) -> None:
        words = [word.partition("=") for word in steps.split(",")]
        self.slept = 0.0
        self.stepped: float | None = None
        self._first = next((float(seconds) for name, _, seconds in words if name == "at"), None)
        self._steps = [(name, float(seconds)) for name, _, seconds in words if name != "at"]

    def elapsed(self) -> float:
        return real_elapsed() + self.slept

    def utc(self) -> float:
        if self.stepped is None:
            self.stepped = 0.0 if self._first is None else self._first - time.time()
        return time.time() + self.stepped + self.slept

    def take_next(self, *_: object) -> None:
        name, seconds = self._steps.pop(0)
        if name == "step":
            self.stepped = (self.stepped or 0.0) + seconds
        else:
            self.slept += seconds


def put_in(odd: OddClocks) -> None:
    """Have all of the program go by these clocks; before any of it is imported."""
    put("clock.elapsed", odd.elapsed)
    put("SystemClock.monotonic", staticmethod(odd.elapsed))  # the same but for the hours
    put("SystemClock.utc", staticmethod(odd.utc))
    signal.signal(signal.SIGUSR1, odd.take_next)


if __name__ == "__main__":
    put_in(OddClocks(sys.argv.pop(1)))
    from support.product import command_main

    command_main()
