"""The stations of `oracles.outside_bench` at the ends of wires to which the happenings of a history
happen. Nothing here knows jbclog.
"""

from __future__ import annotations

import random
from collections.abc import Callable

from support.histories.drawn import Bench, Happening
from support.oracles.outside_bench import OWN_HABITS as OWN
from support.oracles.outside_bench import Cable, Habits, HotAir, Row, Soldering, Station, station

DRAIN_C_S = 85.0  # what a joint takes out of a tip
DWELL_S = 1.2


class OmegaCable:
    """An OMEGA that knows what manual 003 prints: A, which it answers with a, and silence to all
    else. It reads byte by byte, from STX to the two characters of SUM behind ETX.
    """

    station = None  # that anything else than its answers could happen to

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.p = 0.0
        self.rows: list[Row] = []
        self.flags = rng.choice(("", "0"))  # no manual says whether it sends a digit
        self.silent_from: float | None = None
        self.is_silent_to: Callable[[str], bool] = lambda _text: False
        self._heard = b""

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        self.rows.append(Row(now, "asked", data, ""))
        coming: list[tuple[float, bytes]] = []
        for place in range(len(data)):
            self._heard = (self._heard + data[place : place + 1])[-16:]
            at = now + (place + 1) * 10 / 9600 + self.rng.uniform(0.0, 0.25)
            start = self._heard.rfind(b"\x02")
            text = self._heard[start + 1 : -3].decode("latin-1")
            if start < 0 or self._heard != self._heard[:start] + summed(text):
                continue
            self._heard = b""
            self.rows.append(Row(at, "heard", summed(text), ""))
            is_lost = self.rng.random() < self.p
            if text != "A" or is_lost or self.silent_from is not None or self.is_silent_to(text):
                continue
            back = summed(f"a{self.flags}")
            self.rows.append(Row(at, "said", back, ""))
            coming.append((at + len(back) * 10 / 9600, back))
        return coming


def summed(text: str) -> bytes:
    """The frame of an OMEGA (003, 11.2)."""
    body = text.encode("latin-1")
    return b"\x02" + body + b"\x03" + f"{sum(body) % 256:02X}".encode()


class Wire:
    """A peer of a session: a cable, and what happens to it and to its station."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.rng = random.Random(f"{bench.seed} wire")
        if bench.family == "omega":
            self.cable = OmegaCable(random.Random(bench.seed))
        else:
            self.cable = Cable(_station(bench, bench.seed), random.Random(bench.seed))
        self._first: float | None = None
        self._last = 0.0
        self._before = b""  # its last answer
        self._to_come = [it for it in bench.happenings if it.what != "unasked bytes"]
        self._going: list[tuple[float, Happening]] = []

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        self._advance(now)
        pieces = self.cable.receive(data, now)
        own = pieces
        for _, happening in self._going:
            if happening.what == "late":
                pieces = [(at + happening.value, piece) for at, piece in pieces]
            if happening.what == "garbage":
                pieces = [(at, self._noise() + piece) for at, piece in pieces]
            if happening.what == "stale" and self._before and self.rng.random() < 0.3:
                # the answer before comes once more, before the one that is due or in its place
                own_too = pieces if self.rng.random() < 0.5 else []
                pieces = [*[(at, self._before) for at, _ in pieces[:1]], *own_too]
        self._before = own[0][1] if own else self._before
        return pieces

    def is_unplugged(self, now: float) -> bool:
        if self._first is None:
            return False
        passed = now - self._first
        return any(
            happening.what == "unplugged" and 0 <= passed - happening.at < happening.seconds
            for happening in self.bench.happenings
        )

    # -- what happens ------------------------------------------------------------------------------

    def _advance(self, now: float) -> None:
        """Let everything happen that is to happen until `now`."""
        if self._first is None:
            self._first = self._last = now
        passed = now - self._first
        for end, happening in [*self._going]:
            if passed >= end:
                self._going.remove((end, happening))
                self._stop(happening)
        while self._to_come and self._to_come[0].at <= passed:
            happening = self._to_come.pop(0)
            self._going.append((happening.at + happening.seconds, happening))
            self._begin(happening, now)
        for _, happening in self._going:
            if happening.what == "contacts":
                self._touch(happening, now)
        self._last = now

    def _begin(self, happening: Happening, now: float) -> None:
        cable = self.cable
        value = int(happening.value)
        match happening.what:
            case "station error" if isinstance(cable, OmegaCable):
                cable.flags = str(1 + value % 2)
            case "lossy":
                cable.p = happening.value
            case "silence":
                cable.silent_from = now
            case "deaf":
                cable.is_silent_to = lambda text: text.startswith(happening.text)
            case "refusal":
                cable.refuses = lambda text: value if text.startswith(happening.text) else 0
            case "robot off":
                cable.station.habits.robot_mode = False
            case "slow":
                cable.station.habits.usual_s = happening.value
                cable.station.habits.slowest_s = 3 * happening.value
            case "stubborn":
                for port in cable.station.ports.values():
                    port._extractor_cools = False
            case "name":
                cable.station.name = happening.text
            case "station error":
                cable.station.station_error = value
            case "exchange":
                cable.station = _station(self.bench, self.bench.seed + 1 + value)
                cable.station.name = happening.text or cable.station.name
            case "restart":
                cable.station = _station(self.bench, self.bench.seed)
                cable.silent_from = now
            case _ if isinstance(cable.station, Soldering):
                self._begin_at_port(cable.station, happening, now)
            case _ if isinstance(cable.station, HotAir):
                self._begin_at_air(cable.station, happening)

    def _begin_at_port(self, soldering: Soldering, happening: Happening, now: float) -> None:
        port = soldering.ports[1]
        port.live(now)
        value = int(happening.value)
        match happening.what:
            case "tool":
                port.tool = value
            case "select":
                port.selected = value
            case "high":
                port.high = f"{value:05d}"
            case "heat":
                port.temperature = max(port.temperature + happening.value, 20.0)
            case "status":
                port.order(now, value % 10, value // 10, 0)

    def _begin_at_air(self, air: HotAir, happening: Happening) -> None:
        value = int(happening.value)
        match happening.what:
            case "select":
                air.store["ST1"] = f"{value:05d}"
            case "high":
                air.store["SF1"] = f"{value:05d}"
            case "heat":
                air.air = max(air.air + happening.value, 20.0)
            case "status":
                air.is_on = value % 2

    def _stop(self, happening: Happening) -> None:
        cable = self.cable
        match happening.what:
            case "lossy":
                cable.p = 0.0
            case "silence" | "restart":
                cable.silent_from = None
            case "deaf":
                cable.is_silent_to = lambda _text: False
            case "refusal":
                cable.refuses = lambda _text: 0
            case "robot off":
                cable.station.habits.robot_mode = True

    def _touch(self, happening: Happening, now: float) -> None:
        """Take heat out of each tip while it makes a joint."""
        assert self._first is not None
        into = (now - self._first - happening.at) % (2 * DWELL_S + happening.value)
        if into < DWELL_S:
            for port in self.cable.station.ports.values():
                if port.units == 0 and not port.extractor:
                    port.live(now)
                    port.temperature -= DRAIN_C_S * min(now - self._last, 0.3)

    def _noise(self) -> bytes:
        return bytes(self.rng.randrange(256) for _ in range(self.rng.randrange(1, 7)))


def _station(bench: Bench, seed: int) -> Station:
    habits = Habits(**vars(OWN[bench.family]))
    habits.address = bench.address
    return station(bench.family, random.Random(seed), habits, tools=bench.tools)
