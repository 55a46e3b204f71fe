"""The seam between the wire and the physics: what a device asks of one kind of station, whatever it is the station for.

`soldering.py` has the soldering stations' face, `airface.py` that of hot air. The command tables are the client's own.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Protocol

from jbclog.config.sim_spec import FaultSpec
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command
from jbclog.sim.questions import Asked
from jbclog.sim.readings import Identity


class Face(Protocol):
    """One kind of station as its command table sees it. Times are monotonic seconds, `port` is 0 for the station itself."""

    @property
    def ports(self) -> Collection[int]:
        """The ports that there are."""

    def advance_to(self, moment: float) -> None:
        """Let time go on in the physics."""

    def value_of(self, asked: Asked, identity: Identity, now: float) -> Value:
        """The value that an answer to `asked` carries; OFF is told as 99999."""

    def allowed(self, command: Command, value: Value) -> bool:
        """Whether the station takes this value of a well-formed write."""

    def apply(self, asked: Asked, value: Value, now: float) -> None:
        """Let the physics know of an accepted write."""

    def restart(self, now: float) -> None:
        """Lose what is volatile, as after the mains switch."""

    def keep(self) -> None:
        """Take the settings as they are for those that a restart comes back to."""

    def strike(self, fault: FaultSpec, port: int, *, begins: bool) -> None:
        """Let a fault of the physics (``stuck``, ``overheat``, ``tool``) begin or end on `port`."""
