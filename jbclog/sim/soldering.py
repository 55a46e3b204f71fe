"""The face of the soldering stations: `readings.py` and `writings.py` over the physics of `plant.py`."""

from __future__ import annotations

from collections.abc import Collection

from jbclog.config.sim_spec import FaultSpec
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.sim.plant import Plant
from jbclog.sim.questions import Asked
from jbclog.sim.readings import Identity, value_of
from jbclog.sim.writings import allowed, apply, is_beyond_inferred


class SolderingFace:
    """A soldering station of `family` as its command table sees it. `strict`: it holds the limits that are only inferred, too."""

    def __init__(self, family: Family, plant: Plant, *, strict: bool = False) -> None:
        self.family = family
        self.plant = plant
        self.strict = strict

    @property
    def ports(self) -> Collection[int]:
        return self.plant.ports

    def advance_to(self, moment: float) -> None:
        self.plant.advance_to(moment)

    def value_of(self, asked: Asked, identity: Identity, now: float) -> Value:
        return value_of(asked, self.plant, identity, now)

    def allowed(self, command: Command, value: Value) -> bool:
        return allowed(command, value, self.family, self.plant) and not (self.strict and is_beyond_inferred(command, value))

    def apply(self, asked: Asked, value: Value, now: float) -> None:
        apply(asked, value, self.plant, now)

    def restart(self, now: float) -> None:
        self.plant.restart(now)

    def keep(self) -> None:
        self.plant.store()

    def strike(self, fault: FaultSpec, port: int, *, begins: bool) -> None:
        struck = self.plant.ports[port]
        match fault.kind:
            case "stuck":
                struck.stuck_c = struck.temperature() if begins else None
            case "overheat":
                struck.runaway_by_c = fault.by_c if begins else None
                struck.changed()
            case "tool":
                struck.plug(fault.code if begins else struck.tool_before)
