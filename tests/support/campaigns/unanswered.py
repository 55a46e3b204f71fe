"""Recorders that are killed while their stations hear and cannot be heard.

Stations and physics are those of `outside_bench`, written from the manuals; a `Link` loses or
garbles what a station says. What was ordered, and whether a tool got warmer by it, is read at the
stations: each tool has a twin from the moment of the death, which gets no order.
"""

from __future__ import annotations

import copy
import random
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from support.oracles.outside_bench import Cable, HotAir, Port, Served, Soldering, Written, cable
from support.oracles.outside_bench import line_file as written_line
from support.oracles.printed_omega import PageOmega

HARMS = ("", "dead", "thin", "garbled")
LOST = 0.9  # of the bytes, where the link is thin
HOT_C = 350.0
TOLERATED_C = 1.0

WORKING, STAND, EXTRACTOR = "00000", "00001", "00010"
OLD = "soldering"  # manual 000: it has no 00010

RECIPES = {
    "tip": """
[recipe]
name = "unanswered-tip"
revision = 1
families = ["soldering", "dde", "nae", "dme", "hde", "ucr", "ale"]
[temperature]
select_c = 350
[sleep]
delay_min = 5
[hibernation]
delay_min = 30
[sampling]
rate_hz = "auto"
[run]
status = "working"
on_difference = "continue"
""",
    "air": """
[recipe]
name = "unanswered-air"
revision = 1
families = ["jtse"]
[air]
temperature_c = 300
[sampling]
rate_hz = "auto"
[run]
status = "on"
on_difference = "continue"
""",
    "omega": """
[recipe]
name = "unanswered-omega"
revision = 1
families = ["omega"]
""",
}


def family_of(name: str) -> str:
    """`ucr-2` is of the family `ucr`."""
    return name.partition("-")[0]


class Link:
    """A cable whose bytes towards us suffer from a moment on. Whoever looks at stations that are
    served takes the lock, which all share.
    """

    lock = threading.Lock()

    def __init__(self, cable: Cable, seed: int) -> None:
        self.cable = cable
        self.harm = ""
        self.heard = 0  # bytes from us
        self._rng = random.Random(seed)

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        with Link.lock:
            self.heard += len(data)
            answers = [(at, self._harmed(answer)) for at, answer in self.cable.receive(data, now)]
        return [(at, answer) for at, answer in answers if answer]

    def _harmed(self, data: bytes) -> bytes:
        if self.harm == "dead":
            return b""
        if self.harm == "thin":
            return bytes(byte for byte in data if self._rng.random() > LOST)
        if self.harm == "garbled":
            return bytes(byte ^ self._rng.randrange(1, 256) for byte in data)
        return data


@dataclass(frozen=True)
class Tool:
    """A tool of a station, wherever the station's cable leads; hot air has port 1."""

    station: str
    port: int
    heater: Port | HotAir

    @property
    def key(self) -> str:
        return f"{self.station}:{self.port}"

    @property
    def celsius(self) -> float:
        with Link.lock:
            return celsius(self.heater)

    @property
    def status(self) -> str:
        """The status that its station holds, without suction."""
        if isinstance(self.heater, HotAir):
            return f"000{self.heater.cooling}{self.heater.is_on}"
        return f"000{self.heater.extractor}{self.heater.units}"

    @property
    def is_working(self) -> bool:
        return self.status == (STAND if isinstance(self.heater, HotAir) else WORKING)

    def copied(self) -> Port | HotAir:
        """A twin that nobody orders anything."""
        with Link.lock:
            celsius(self.heater)
            return copy.deepcopy(self.heater)


def celsius(heater: Port | HotAir) -> float:
    heater.live(time.monotonic())
    return heater.air if isinstance(heater, HotAir) else heater.temperature


@dataclass
class Bench:
    """Stations by name (family, or family-NUMBER) and the links to them."""

    names: Sequence[str]
    seed: int = 0
    links: dict[str, Link] = field(default_factory=dict)
    omegas: dict[str, PageOmega] = field(default_factory=dict)
    stations: dict[str, Cable] = field(default_factory=dict)
    strangers: list[Link] = field(default_factory=list)  # plugged in where others were
    served: Served | None = None
    guard: int = 0  # its process
    folder: Path = Path()  # of the names of its ports

    def __post_init__(self) -> None:
        for number, name in enumerate(self.names):
            if family_of(name) == "omega":
                self.omegas[name] = PageOmega()
                continue
            self.stations[name] = cable(family_of(name), 100 * self.seed + number)
            self.links[name] = Link(self.stations[name], 100 * self.seed + number)
            warm(self.stations[name])

    @property
    def peers(self) -> dict[str, Link | PageOmega]:
        return {**self.links, **self.omegas}

    def tools(self) -> list[Tool]:
        tools = []
        for name, wire in self.stations.items():
            if isinstance(wire.station, HotAir):
                tools.append(Tool(name, 1, wire.station))
            else:
                tools += [Tool(name, port, heater) for port, heater in wire.station.ports.items()]
        return tools

    def harm(self, how: str, names: Sequence[str] = ()) -> None:
        """Spoil what these stations say, or what all say."""
        for name in names or self.links:
            self.links[name].harm = how

    def swap(self, first: str, second: str) -> None:
        """Plug the cables of two stations into each other's adapters."""
        left, right = self.links[first], self.links[second]
        with Link.lock:
            left.cable, right.cable = right.cable, left.cable

    def change_device(
        self, name: str, *, same_number: bool = False, software: str = "01.09"
    ) -> None:
        """Have another station, whose tool sleeps, behind another pseudo-terminal by that name."""
        assert self.served is not None
        family = family_of(name)
        stranger = Link(cable(family, 100 * self.seed + 99), 99)
        stranger.harm = self.links[name].harm
        assert isinstance(stranger.cable.station, Soldering)
        stranger.cable.station.software = software
        for port in stranger.cable.station.ports.values():
            port.order(time.monotonic(), 2, 0, 0)
        if same_number:
            self.served.unplug(name)
        self.served.plug(name, stranger, self.folder)  # type: ignore[arg-type]  # it receives
        self.strangers.append(stranger)

    def orders(self, name: str, since: float) -> list[Written]:
        """Writes that this station understood since then, whether it took them or not."""
        return [write for write in list(self.stations[name].written) if write.at >= since]

    def statuses_read(self, since: float, names: Sequence[str]) -> int:
        """How often the least asked tool of these stations was asked for its status."""
        counts = [
            sum(
                row.what == "heard" and row.at >= since and f"RPS{tool.port}".encode() in row.data
                for row in list(self.stations[tool.station].rows)
            )
            for tool in self.tools()
            if tool.station in names
        ]
        return min(counts, default=0)

    def line_file(
        self, served: Served, folder: Path, *, safe_state: str = "", suction: bool = False
    ) -> Path:
        """The line with its recipes."""
        texts = dict(RECIPES)
        if safe_state:
            tip = texts["tip"].replace('"soldering", ', "")
            texts["tip"] = f'{tip}safe_state = "{safe_state}"\n'
        if suction:
            texts["air"] = texts["air"].replace("[air]", '[air]\nsuction = "on"')
        for kind, text in texts.items():
            (folder / f"{kind}.toml").write_text(text)
        kinds = {"jtse": "air", "omega": "omega"}
        families = {station: family_of(station) for station in self.names}
        keys = {
            station: f'recipe = "{kinds.get(family, "tip")}.toml"'
            for station, family in families.items()
        }
        path = folder / "line.toml"
        path.write_text(written_line(served.urls, families, more=keys))
        return path


def warm(wire: Cable) -> None:
    """Have tools wait for their robot in stand, hot."""
    if isinstance(wire.station, Soldering):
        for port in wire.station.ports.values():
            port.temperature = HOT_C
            port.order(time.monotonic(), 1, 0, 0)


@dataclass
class Outcome:
    """What became of the tools after a death. Orders are those of the status."""

    seconds: dict[str, float]  # until each tool had the status that it should get, by its key
    hotter: list[str]
    orders: dict[str, list[tuple[float, str]]]
    others: list[tuple[str, str]]  # station and any other write


def watched(
    bench: Bench, wanted: dict[str, str], twins: dict[str, Port | HotAir], at: float, for_s: float
) -> Outcome:
    """Watch the tools until `for_s` after a death `at` (monotonic seconds)."""
    tools = {tool.key: tool for tool in bench.tools()}
    before = {key: celsius(copy.deepcopy(twin)) for key, twin in twins.items()}
    seconds: dict[str, float] = {}
    hotter: dict[str, float] = {}
    while time.monotonic() < at + for_s:
        for key, tool in tools.items():
            limit = max(before[key], celsius(twins[key])) + TOLERATED_C
            if tool.celsius > limit:
                hotter[key] = tool.celsius
            if key in wanted and key not in seconds and tool.status == wanted[key]:
                seconds[key] = time.monotonic() - at
        time.sleep(0.05)
    orders: dict[str, list[tuple[float, str]]] = {key: [] for key in tools}
    others = []
    for name in bench.stations:
        for write in bench.orders(name, at):
            key = f"{name}:{write.code[2]}"
            if write.error == 4 and write.data[3:] == EXTRACTOR[3:]:
                continue  # of another station's port
            if write.code.startswith("PS") and key in orders:
                orders[key].append((round(write.at - at, 2), write.data))
            else:
                others.append((name, write.code + write.data))
    for name, omega in bench.omegas.items():
        others += [(name, text) for text in omega.texts if text[:1] in "DH"]
    return Outcome(seconds, sorted(hotter), orders, others)
