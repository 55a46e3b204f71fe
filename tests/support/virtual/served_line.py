"""A line of virtual stations served on real pseudo-terminals by this process: their own log and
physics can be looked at.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Self

from support.command import recipe_text
from support.product import (
    SERVED_LINE,
    SIM_STAND,
    SIM_WORKING,
    STAND,
    AcceptedWrite,
    ByteLog,
    SimPort,
    SimServer,
    SolderingModel,
    Value,
    VirtualStation,
    load_line,
    set_up_sim,
)

FOUR_TOOLS = """
[line]
name = "bench"

[[station]]
name = "dme-1"
url = "dme-1"
family = "dme"
[station.sim]
tools = {1 = 2, 2 = 2, 3 = 2, 4 = 2}
extractor_cools = false
"""

EXTRACTING = recipe_text(
    "extracting", "dme", more='safe_state = "extractor"\n[sampling]\nrate_hz = 1\n'
)

LINE = """
[line]
name = "bench"

[[station]]
name = "dde-1"
url = "dde-1"
family = "dde"
[station.sim]
joints_per_minute = 30

[[station]]
name = "dde-2"
url = "dde-2"
family = "auto"
[station.sim]
model = "DDE"
joints_per_minute = 20

[[station]]
name = "ucr-1"
url = "ucr-1"
family = "ucr"
[station.sim]
tool = 9
joints_per_minute = 40

[[station]]
name = "ale-1"
url = "ale-1"
family = "ale"
[station.sim]
joints_per_minute = 60
joint_seconds = 0.5
feed_each_joint = true
"""

RECIPE = recipe_text(
    "guarded",
    "dde",
    "ucr",
    "ale",
    more="""require_tool = false
[feeder]
mode = "continuous"  # it runs from the robot's first start until somebody stops it
[sampling]
rate_hz = 5
""",
)


HOT_C = 340.0


@dataclass(frozen=True)
class Order:
    """A write that a station took."""

    at: float
    station: str
    port: int
    name: str
    value: Value

    @property
    def is_stand(self) -> bool:
        return self.name == "status" and self.value == STAND

    @property
    def is_safe(self) -> bool:
        """Whether it belongs to making safe."""
        return self.is_stand or self.name == "stop_feeding"


class ServedLine:
    """Serves `text` below `folder` while a `with` lasts, all tools hot and in stand at first.

    `path` is the line file for a run, `recipe` one that fits it; `log` holds all that passed on the
    wires, if it was asked for.
    """

    def __init__(
        self, folder: Path, text: str = LINE, recipe: str = RECIPE, *, logs: bool = False
    ) -> None:
        self.log = folder / "wire.jsonl" if logs else None
        source = folder / "source.toml"
        source.write_text(text, encoding="utf-8")
        self.recipe = folder / "recipe.toml"
        self.recipe.write_text(recipe, encoding="utf-8")
        self.path = folder / "served" / SERVED_LINE
        self._line = load_line(source)
        self.stations: dict[str, VirtualStation] = {}
        self._wire_file = ByteLog(self.log) if self.log else None
        self._server: SimServer | None = None
        self._thread: Thread | None = None

    def __enter__(self) -> Self:
        now = time.monotonic()
        self.stations = {spec.name: VirtualStation(spec, now=now) for spec in self._line.stations}
        for port in self.tools():
            port.order(SIM_STAND, False)
            port.tip.temperature_c = HOT_C  # a robot waits for a hot tip
        self._server = set_up_sim(
            self._line, self.path.parent, None, self._wire_file, list(self.stations.values())
        )
        self._thread = Thread(target=self._server.run, name="virtual-stations", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._server is not None and self._thread is not None:
            self._server.stop()
            self._thread.join(5.0)
        if self._wire_file is not None:
            self._wire_file.close()

    def url(self, name: str) -> str:
        return str(self.path.parent / name)

    def orders(self, since: float = 0.0) -> list[Order]:
        """What was written to the stations after `since` (monotonic seconds), by time."""
        found = [
            self._order(name, write)
            for name, one in self.stations.items()
            for write in one.log.writes
            if write.at > since
        ]
        return sorted(found, key=lambda order: order.at)

    @staticmethod
    def _order(station: str, write: AcceptedWrite) -> Order:
        return Order(write.at, station, write.port, write.name, write.value)

    def questions(self) -> int:
        """How many were answered so far, writes among them."""
        return sum(
            station.log.reads + len(station.log.writes) for station in self.stations.values()
        )

    def motor(self, name: str) -> bool:
        """Whether the feeder of this station turns now."""
        return self.stations[name].plant.feeder.motor(time.monotonic()) != 0

    def tools(self) -> list[SimPort]:
        """All tools, with the ports that they are in."""
        soldering = (
            one for one in self.stations.values() if isinstance(one.device.face, SolderingModel)
        )
        return [port for station in soldering for port in station.plant.ports.values() if port.tool]

    def cool_soon(self) -> None:
        """Set the delays with which a tool in stand cools."""
        for port in self.tools():
            port.tools[port.tool].sleep_delay, port.tools[port.tool].hibernation_delay = 5, 30

    def at_work(self) -> int:
        """How many tools are at work now."""
        return sum(
            port.doing.state == SIM_WORKING and not port.doing.extractor for port in self.tools()
        )
