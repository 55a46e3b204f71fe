"""Virtual stations that are written from the manuals alone, by somebody who had not seen those of
`jbclog.sim`, nor the sessions.

`station` makes one of each family of manuals 000, 001 and 002, each with habits of its own where
the manuals are silent. A `Cable` carries frames to one and back, has each of nine kinds of accident
with probability `p`, and keeps a list of all that was asked, heard, done and said. It is a peer of
the virtual clock (`receive`, `is_unplugged`); `Served` serves cables on real pseudo-terminals and
TCP ports instead, in a thread.
"""

from __future__ import annotations

import contextlib
import heapq
import os
import pty
import random
import selectors
import socket
import threading
import time
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

STX, ETX = 2, 3
ROOM_C = 22.0
OFF = "99999"

# -- frames (002, Data Link Layer) -----------------------------------------------------------------


def framed(text: str) -> bytes:
    body = bytes([STX]) + text.encode("latin-1") + bytes([ETX])
    check = 0
    for byte in body:
        check ^= byte
    return body + bytes([check])


def number(value: float) -> str:
    whole = round(value)
    return f"{whole:05d}"


def delay(seconds: float | None) -> str:
    return OFF if seconds is None else f"{seconds:05.2f}"


# -- stations --------------------------------------------------------------------------------------


@dataclass
class Habits:
    """What the manuals do not say."""

    address: int | None = 1
    # the answer's address fields are those of the question, not turned round
    host_first: bool = False
    transformer_pad: str = ""  # between TT and the digits of the answer to R-TT
    transformer_wants_pad: bool = False  # R-TT without a third character is a format error
    refusal: str = "{code}{error}"  # text of an N frame after the letter
    ack_with_data: bool = False  # W-PS is acknowledged with the new status
    keeping_s: float = 0.004  # until a setting that is kept is acknowledged
    fastest_s: float = 0.0005
    usual_s: float = 0.003
    slowest_s: float = 0.020
    # "printed": of its own manual; "002": those of 002, though not its own; "none"
    limits: str = "printed"
    not_counting: str = "00000"  # answer to R-ED when nothing is counted down
    alarm_unset: str = "00000"
    extractor_cools: bool = True
    combined_status: bool = True  # JTSE takes 00110
    restless_c: float = 0.0  # a tip at work is read as this much more or less
    robot_mode: bool = True


class Port:
    """One tool, its heat, and its settings. It knows no protocol."""

    def __init__(self, tool: int, rng: random.Random, extractor_cools: bool) -> None:
        self.tool = tool
        self.selected = 350
        self.units, self.extractor, self.suction = 0, 1, 0
        self.high = self.low = ""
        self.high_delay = self.low_delay = OFF
        self.adjust: dict[int, str] = {}
        self.sleep_c: dict[int, int] = {}
        self.sleep_min: dict[int, str] = {}
        self.hibernation_min: dict[int, str] = {}
        self.flags = 0
        self.temperature = ROOM_C
        self.power = 0.0
        self.since = 0.0  # when it was told its status
        self.counters = {
            name: rng.randrange(10, 9000)
            for name in ("CP", "CN", "CS", "CH", "CW", "CC", "CD", "DC")
        }
        self.length = rng.randrange(0, 0xFFFFF)
        self._looked: float | None = None
        self._rng = rng
        self._extractor_cools = extractor_cools

    def sleep_delay_s(self) -> float | None:
        value = self.sleep_min.get(self.tool, "00005")
        return None if value == OFF else int(value) * 60.0

    def hibernation_delay_s(self) -> float | None:
        value = self.hibernation_min.get(self.tool, "00030")
        return None if value == OFF else int(value) * 60.0

    def remaining_s(self, now: float) -> float | None:
        self.live(now)
        wanted = {1: self.sleep_delay_s(), 2: self.hibernation_delay_s()}.get(self.units)
        return None if wanted is None else max(self.since + wanted - now, 0.0)

    def order(self, now: float, units: int, extractor: int, suction: int) -> None:
        self.live(now)
        self.units, self.extractor, self.suction, self.since = units, extractor, suction, now

    def target(self) -> float:
        if self.tool == 0 or (self.extractor and self._extractor_cools):
            return ROOM_C
        return [self.selected, self.selected, self.sleep_c.get(self.tool, 150), ROOM_C][self.units]

    def live(self, now: float) -> None:
        """Warm up or cool down until `now`."""
        began = now if self._looked is None else self._looked
        while began < now:
            step = min(now - began, 0.25)
            began += step
            self._fall_asleep(began)
            away = self.target() - self.temperature
            if away > 1.5:
                self.temperature += min(70.0 * step, away)
                self.power = 1000.0
            else:
                self.temperature += away * min(step / 25.0, 1.0)
                self.power = (
                    0.0
                    if away < -2
                    else max(self.temperature - ROOM_C, 0) * 0.45 + self._rng.uniform(0, 15)
                )
            self._watch(began)
        self._looked = now

    def _fall_asleep(self, now: float) -> None:
        if self.extractor:
            return
        for units, wait in ((1, self.sleep_delay_s()), (2, self.hibernation_delay_s())):
            if self.units == units and wait is not None and now - self.since >= wait:
                self.units, self.since = units + 1, self.since + wait

    def _watch(self, now: float) -> None:
        if self.high and self.high_delay != OFF and self.temperature > int(self.high):
            self.flags |= 1
        if self.low and self.low_delay != OFF and self.temperature < int(self.low):
            self.flags |= 2


class Written(NamedTuple):
    at: float
    code: str
    data: str
    error: int  # 0: taken


Taken = int
"""0, or the number of an N frame."""


class Station(ABC):
    """What a station answers to a question, and how long it takes. `stored` is its state by the
    code of the reading.
    """

    def __init__(self, family: str, name: str, rng: random.Random, habits: Habits) -> None:
        self.family = family
        self.name = name
        self.habits = habits
        self.rng = rng
        self.maximum, self.minimum = 500, 90
        self.store: dict[str, str] = {}
        self.ports: dict[int, Port] = {}
        self.station_error = 0

    # -- reading and writing: by family ------------------------------------------------------------

    @abstractmethod
    def read(self, code: str, now: float) -> str | None:
        """What is answered to a read; None: no such command here."""

    @abstractmethod
    def write(self, code: str, data: str, now: float) -> Taken:
        """What becomes of a write."""

    @abstractmethod
    def is_known_write(self, code: str) -> bool:
        """Whether there is such a write at all."""

    def stored(self, code: str, now: float) -> str | None:
        """What it would answer, without being asked; nothing is cleared by it."""
        if code[:2] == "TA":
            return None
        return self.read(code, now)

    def think_s(self, is_write: bool) -> float:
        """A few milliseconds, sometimes many."""
        habits = self.habits
        usual = habits.fastest_s + self.rng.expovariate(1.0 / habits.usual_s)
        if self.rng.random() < 0.03:
            usual *= 6
        return min(usual, habits.slowest_s) + (habits.keeping_s if is_write else 0.0)


SOLDERING_WRITES = ("ST", "PS", "HA", "LA", "HD", "LD")


class Soldering(Station):
    """Manuals 000 and 002."""

    def __init__(
        self, family: str, name: str, rng: random.Random, habits: Habits, tools: Sequence[int]
    ) -> None:
        super().__init__(family, name, rng, habits)
        self.ports = {
            at: Port(tool, rng, habits.extractor_cools) for at, tool in enumerate(tools, start=1)
        }
        self.feeder = {
            "MOD": "00000",
            "LEN": "00100",
            "SPD": "00080",
            "DIA": "00080",
            "BCK": "00005",
            "WCD": "00000",
        }
        self.feeding = False
        self.software = "01.07"

    def _place(self, code: str) -> tuple[Port, int] | None:
        """The port, and the tool, of a code of one letter with both."""
        if len(code) == 3 and code[0] in "ASDH" and code[1:].isdigit():
            port = self.ports.get(int(code[1]))
            return None if port is None else (port, int(code[2]))
        return None

    def read(self, code: str, now: float) -> str | None:
        whole = self._read_station(code)
        if whole is not None:
            return whole
        place = self._place(code)
        if place is not None:
            port, tool = place
            return {
                "A": port.adjust.get(tool, "00000"),
                "S": number(port.sleep_c.get(tool, 150)),
                "D": port.sleep_min.get(tool, "00005"),
                "H": port.hibernation_min.get(tool, "00030"),
            }[code[0]]
        if len(code) == 3 and code[2].isdigit() and int(code[2]) in self.ports:
            return self._read_port(code[:2], self.ports[int(code[2])], now)
        return None

    def _read_station(self, code: str) -> str | None:
        known = {
            "MAT": number(self.maximum),
            "MIT": number(self.minimum),
            "SMN": f"{self.name:>5}",
            "SER": number(self.station_error),
        }
        known["TT"] = number(41 + self.rng.randrange(3))
        if self.family == "ucr":
            known["FST"] = "00001"
        if self.family == "ale":
            known.update(self.feeder, FEE=number(self.feeding))
        if self.family != "soldering":
            known["SVR"] = self.software
        return known.get(code)

    def _read_port(self, two: str, port: Port, now: float) -> str | None:
        port.live(now)
        if two in port.counters:
            if two == "DC" and self.family not in ("ale", "ucr"):
                return None
            return number(port.counters[two])
        if two == "DL":
            return f"{port.length:05X}" if self.family in ("ale", "ucr") else None
        if two == "TA":
            flags, port.flags = port.flags, 0
            return f"000{flags >> 1 & 1}{flags & 1}"
        remaining = port.remaining_s(now)
        answers: dict[str, Callable[[], str]] = {
            "ST": lambda: number(port.selected),
            "TT": lambda: number(port.temperature + self._wandering()),
            "PP": lambda: number(min(port.power, 1000)),
            "PE": lambda: "00000" if port.tool else "00004",
            "PS": lambda: f"00{port.suction}{port.extractor}{port.units}",
            "CT": lambda: number(port.tool),
            "ED": lambda: self.habits.not_counting if remaining is None else number(remaining),
            "QT": lambda: number(30 + port.power / 50),
            "HA": lambda: port.high or self.habits.alarm_unset,
            "LA": lambda: port.low or self.habits.alarm_unset,
            "HD": lambda: port.high_delay,
            "LD": lambda: port.low_delay,
        }
        return answers[two]() if two in answers else None

    def _wandering(self) -> float:
        swing = self.habits.restless_c
        return self.rng.uniform(-swing, swing) if swing else 0.0

    def is_known_write(self, code: str) -> bool:
        if code in ("MAT", "MIT", "RSP", "RST"):
            return True
        if code in ("NVS", "IFE"):
            return self.family != "soldering"
        if self.family == "ucr" and code == "SAD":
            return True
        if self.family == "ale" and (code in self.feeder or code in ("STR", "STP")):
            return True
        if self._place(code) is not None:
            return True
        return (
            len(code) == 3
            and code[:2] in SOLDERING_WRITES
            and code[2].isdigit()
            and int(code[2]) in self.ports
        )

    def write(self, code: str, data: str, now: float) -> Taken:
        if code in ("STR", "STP"):
            self.feeding = code == "STR"
            return 0
        if code in self.feeder and self.family == "ale":
            if (
                not data.isdigit()
                or (code == "MOD" and int(data) > 3)
                or (code == "WCD" and int(data) > 1)
            ):
                return 3
            self.feeder[code] = data
            return 0
        if code in ("MAT", "MIT"):
            if code == "MAT":
                self.maximum = int(data)
            else:
                self.minimum = int(data)
            return 0
        if code in ("NVS", "RSP", "RST", "IFE", "SAD"):
            return 0
        place = self._place(code)
        if place is not None:
            return self._write_tool(code[0], *place, data)
        return self._write_port(code[:2], self.ports[int(code[2])], data, now)

    @property
    def _limits(self) -> bool:
        return self.habits.limits == "002" or (
            self.habits.limits == "printed" and self.family != "soldering"
        )

    def _write_tool(self, letter: str, port: Port, tool: int, data: str) -> Taken:
        if letter == "A":
            if (not data.lstrip("-").isdigit()) or abs(int(data)) > 50:
                return 3
            port.adjust[tool] = data
        elif letter == "S":
            if not data.isdigit() or int(data) > self.maximum or (self._limits and int(data) % 5):
                return 3
            port.sleep_c[tool] = int(data)
        elif not data.isdigit():
            return 3
        elif letter == "D":
            if data != OFF and self._limits and int(data) > 9:
                return 3
            port.sleep_min[tool] = data
        else:
            if data != OFF and self._limits and (int(data) > 60 or int(data) % 5):
                return 3
            port.hibernation_min[tool] = data
        return 0

    def _write_port(self, two: str, port: Port, data: str, now: float) -> Taken:
        if two in ("HD", "LD"):
            if data != OFF and not (data[2] == "." and (data[:2] + data[3:]).isdigit()):
                return 3
            setattr(port, "high_delay" if two == "HD" else "low_delay", data)
            return 0
        if not data.isdigit():
            return 3
        if two == "PS":
            if data not in (
                ("00000", "00001") if self.family == "soldering" else ("00000", "00001", "00010")
            ):
                return 3
            port.order(now, int(data[4]), int(data[3]), port.suction)
            return 0
        if self._limits and int(data) % 5:
            return 3
        if two == "ST":
            if not self.minimum <= int(data) <= self.maximum:
                return 3
            port.live(now)
            port.selected = int(data)
        else:
            setattr(port, "high" if two == "HA" else "low", data)
        return 0


AIR_SETTINGS = {
    "ST1": 200,
    "SF1": 300,
    "SE1": 150,
    "WM1": 0,
    "MAT": 450,
    "MIT": 100,
    "MAF": 1000,
    "MIF": 50,
    "MAE": 400,
    "MIE": 25,
}
AIR_LIMITS = {"ST1": ("MIT", "MAT"), "SF1": ("MIF", "MAF"), "SE1": ("MIE", "MAE")}


class HotAir(Station):
    """Manual 001. The air is warm while the tool is on, and cools with the pump."""

    def __init__(self, name: str, rng: random.Random, habits: Habits) -> None:
        super().__init__("jtse", name, rng, habits)
        self.store = {code: number(value) for code, value in AIR_SETTINGS.items()}
        self.adjust = {1: "00000", 2: "00000"}
        self.is_on = self.cooling = self.suction = 0
        self.air = ROOM_C
        self.power = 0.0
        self._looked: float | None = None
        self._hours = rng.randrange(10, 4000)

    def live(self, now: float) -> None:
        began = now if self._looked is None else self._looked
        while began < now:
            step = min(now - began, 0.25)
            began += step
            target = float(self.store["ST1"]) if self.is_on and not self.cooling else ROOM_C
            away = target - self.air
            self.air += away * min(step / (2.0 if away > 0 else 6.0), 1.0)
            self.power = min(max(away * 20, 0) + (400 if target > ROOM_C else 0), 1000.0)
        self._looked = now

    def read(self, code: str, now: float) -> str | None:
        self.live(now)
        if code in self.store:
            return self.store[code]
        if code in ("A11", "A12"):
            return self.adjust[int(code[2])]
        return {
            "AT1": number(self.air),
            "ET1": number(ROOM_C + (self.air - ROOM_C) / 3),
            "PP1": number(self.power),
            "PE1": "00000",
            "PS1": f"00{self.suction}{self.cooling}{self.is_on}",
            "CT1": "00001",
            "SMN": f"{self.name:>5}",
            "SER": number(self.station_error),
            "OH1": number(self._hours),
            "WH1": number(self._hours // 3),
            "TC1": number(self._hours // 2),
            "SC1": number(self._hours // 5),
        }.get(code)

    def is_known_write(self, code: str) -> bool:
        return code in self.store or code in ("A11", "A12", "PS1", "RSP", "RST")

    def write(self, code: str, data: str, now: float) -> Taken:
        self.live(now)
        if code in ("RSP", "RST"):
            return 0
        if code[0] == "A":
            if not data.lstrip("-").isdigit() or abs(int(data)) > 50:
                return 3
            self.adjust[int(code[2])] = data
            return 0
        if not data.isdigit():
            return 3
        if code == "PS1":
            if (
                data[:2] != "00"
                or not set(data[2:]) <= {"0", "1"}
                or (not self.habits.combined_status and data.count("1") > 1)
            ):
                return 3
            self.suction, self.cooling, self.is_on = (int(one) for one in data[2:])
            return 0
        if code in AIR_LIMITS:
            low, high = (int(self.store[one]) for one in AIR_LIMITS[code])
            if not low <= int(data) <= high:
                return 3
        if code == "WM1" and int(data) > 1:
            return 3
        self.store[code] = data
        return 0


# -- the wire --------------------------------------------------------------------------------------

KINDS = (
    "lost there",
    "lost back",
    "flipped",
    "late",
    "N 1",
    "doubled",
    "cut",
    "noise",
    "other address",
)


class Row(NamedTuple):
    """One line of a cable's list. `what`: asked (bytes left the host), heard (the station took a
    frame), said (it answered).
    """

    at: float
    what: str
    data: bytes
    fault: str


@dataclass
class Cable:
    """One station at the end of a wire that is bad now and then."""

    station: Station
    rng: random.Random
    p: float = 0.0
    baudrate: int = 19200
    rows: list[Row] = field(default_factory=list)
    written: list[Written] = field(default_factory=list)
    said: dict[str, list[tuple[float, str]]] = field(default_factory=dict)
    faults: dict[str, int] = field(default_factory=dict)
    silent_from: float | None = None
    silent_until: float = float("inf")
    # of a question's letter, code and data
    is_silent_to: Callable[[str], bool] = lambda _text: False
    refuses: Callable[[str], int] = lambda _text: 0
    # accidents by the question's number, from 0
    script: dict[int, str] = field(default_factory=dict)
    _buffer: bytes = b""
    _byte_at: float = 0.0
    _busy_until: float = 0.0

    def is_unplugged(self, now: float) -> bool:
        return False

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        """What comes back to `data`, each piece with the moment at which it is there."""
        fault = self._fault()
        self.rows.append(Row(now, "asked", data, fault))
        there = now + len(data) * 10 / self.baudrate
        coming: list[tuple[float, bytes]] = []
        for arriving in self._on_the_way_there(data, fault):
            for frame in self._frames(arriving, there):
                coming += self._answered(frame, there, fault)
        return coming

    # -- there -------------------------------------------------------------------------------------

    def _fault(self) -> str:
        number = sum(row.what == "asked" for row in self.rows) if self.script else 0
        if number in self.script:
            return self.script[number]
        drawn = self.rng.random()
        kind = int(drawn / self.p) if self.p else len(KINDS)
        fault = KINDS[kind] if kind < len(KINDS) else ""
        if fault:
            self.faults[fault] = self.faults.get(fault, 0) + 1
        there = fault in ("flipped", "doubled", "cut", "noise") and self.rng.random() < 0.5
        return f"{fault} there" if there else fault

    def _on_the_way_there(self, data: bytes, fault: str) -> list[bytes]:
        if fault == "lost there":
            return []
        if fault == "flipped there":
            return [self._flipped(data)]
        if fault == "doubled there":
            return [data, data]
        if fault == "cut there":
            return [data[: self.rng.randrange(1, len(data))]]
        if fault == "noise there":
            return [self._noise() + data]
        return [data]

    def _flipped(self, data: bytes) -> bytes:
        at = self.rng.randrange(len(data))
        return data[:at] + bytes([data[at] ^ 1 << self.rng.randrange(8)]) + data[at + 1 :]

    def _noise(self) -> bytes:
        return bytes(self.rng.randrange(256) for _ in range(self.rng.randrange(1, 7)))

    def _frames(self, data: bytes, now: float) -> list[bytes]:
        """Whole frames that the receiver makes of `data`: from STX to the byte after the first ETX.
        A pause begins anew.
        """
        if now - self._byte_at > 0.05:
            self._buffer = b""
        self._byte_at = now
        self._buffer += data
        frames = []
        while True:
            start = self._buffer.find(STX)
            self._buffer = b"" if start < 0 else self._buffer[start:]
            end = self._buffer.find(ETX)
            if end < 0 or len(self._buffer) < end + 2:
                if len(self._buffer) > 24:
                    self._buffer = b""
                return frames
            frames.append(self._buffer[: end + 2])
            self._buffer = self._buffer[end + 2 :]

    # -- at the station ----------------------------------------------------------------------------

    def _answered(self, frame: bytes, now: float, fault: str) -> list[tuple[float, bytes]]:
        begun = max(now, self._busy_until)
        text = frame[1:-2].decode("latin-1")
        habits = self.station.habits
        if habits.address is not None:
            if text[2:4] != f"{habits.address:02d}" or not text[:4].isdigit():
                return []
            host, text = text[:2], text[4:]
        else:
            host = ""
        if self.silent_from is not None and self.silent_from <= now < self.silent_until:
            return []
        if self.is_silent_to(text):
            return []
        is_write = text[:1] == "W"
        self.rows.append(Row(begun, "heard", frame, fault))
        is_sound = framed(frame[1:-2].decode("latin-1")) == frame and fault != "N 1"
        answer = self._answer(text, begun) if is_sound else self._refusal(text[1:4], 1)
        done = begun + self.station.think_s(is_write and is_sound)
        if fault == "late":
            done += self.rng.uniform(0.3, 1.5)
        back = framed(self._headed(host, answer))
        self.rows.append(Row(done, "said", back, fault))
        if answer[0] == "A" and text[0] == "R":
            self.said.setdefault(
                text[1:].rstrip(" 0") if text.startswith("RTT") and len(text) < 5 else text[1:], []
            ).append((done, answer[-5:]))
        arrived = done + len(back) * 10 / self.baudrate
        self._busy_until = arrived
        return self._on_the_way_back(back, answer, arrived, fault)

    def _headed(self, host: str, answer: str) -> str:
        habits = self.station.habits
        if habits.address is None:
            return answer
        own = f"{habits.address:02d}"
        return (host + own if habits.host_first else own + host) + answer

    def _refusal(self, code: str, error: int) -> str:
        return "N" + self.station.habits.refusal.format(code=code, error=number(error))

    def _answer(self, text: str, now: float) -> str:
        letter, code, data = text[:1], text[1:4], text[4:]
        habits = self.station.habits
        if letter == "R":
            if text.startswith("RTT") and (
                len(text) == 3 or not text[3].isdigit() or text[3] == "0"
            ):
                return self._transformer(text, now)
            if len(text) != 4:
                return self._refusal(code, 2)
            if not habits.robot_mode:
                return self._refusal(code, 5)
            value = None if self.refuses(text) else self.station.read(code, now)
            return (
                self._refusal(code, self.refuses(text) or 4) if value is None else f"A{code}{value}"
            )
        if letter == "W":
            error = self._write(code, data, now)
            self.written.append(Written(now, code, data, error))
            if error:
                return self._refusal(code, error)
            return f"A{code}{data}" if habits.ack_with_data and code[:2] == "PS" else f"A{code}"
        return self._refusal(code, 2)

    def _transformer(self, text: str, now: float) -> str:
        habits = self.station.habits
        value = self.station.read("TT", now)
        if value is None or (len(text) == 3) == habits.transformer_wants_pad:
            return self._refusal("TT", 4 if value is None else 2)
        return f"ATT{habits.transformer_pad}{value}"

    def _write(self, code: str, data: str, now: float) -> int:
        if not self.station.habits.robot_mode:
            return 5
        if len(data) != 5:
            return 2
        if not self.station.is_known_write(code):
            return 4
        return self.refuses(f"W{code}{data}") or self.station.write(code, data, now)

    # -- back --------------------------------------------------------------------------------------

    def _on_the_way_back(
        self, back: bytes, answer: str, at: float, fault: str
    ) -> list[tuple[float, bytes]]:
        if fault == "lost back":
            return []
        if fault == "flipped":
            return [(at, self._flipped(back))]
        if fault == "doubled":
            return [(at, back), (at + len(back) * 10 / self.baudrate, back)]
        if fault == "cut":
            return [(at, back[: self.rng.randrange(1, len(back))])]
        if fault == "noise":
            return [(at, self._noise() + back)]
        if fault == "other address":
            other = framed(f"{self.rng.choice((5, 20, 99)):02d}00" + self._another(answer))
            return [(at, other), (at + 0.004, back)] if self.rng.random() < 0.5 else [(at, other)]
        return [(at, back)]

    def _another(self, answer: str) -> str:
        """The same with another value: what a neighbour might have said."""
        if answer[0] == "A" and len(answer) == 9 and answer[4:].isdigit():
            return answer[:4] + number(self.rng.randrange(100, 400))
        return answer

    # -- what is in it -----------------------------------------------------------------------------

    def taken(self, start: str = "") -> list[Written]:
        """Writes that it carried out, in order."""
        return [one for one in self.written if one.error == 0 and one.code.startswith(start)]


# -- the bench -------------------------------------------------------------------------------------

TOOLS = {
    "dde": (2, 3),
    "nae": (1, 8),
    "dme": (2, 1, 4, 3),
    "hde": (2,),
    "ucr": (2,),
    "ale": (2,),
    "soldering": (2,),
}
NAMES = {
    "dde": "DDE",
    "nae": "NAE",
    "dme": "DME",
    "hde": "HDE",
    "ucr": "UCR245",
    "ale": "ALE",
    "soldering": "DDR",
    "jtse": "JTSE",
}
FAMILIES = ("dde", "nae", "dme", "hde", "ucr", "ale", "soldering", "jtse")
OWN_HABITS = {
    "dde": Habits(keeping_s=0.3),
    "nae": Habits(host_first=True, refusal="{error}", alarm_unset=OFF),
    "dme": Habits(transformer_pad=" ", not_counting="65535", usual_s=0.005),
    "hde": Habits(transformer_pad="0", transformer_wants_pad=True),
    "ucr": Habits(refusal="???{error}", limits="none", usual_s=0.001),
    "ale": Habits(host_first=True, not_counting=OFF, keeping_s=0.12),
    "soldering": Habits(limits="none", refusal="{error}", usual_s=0.008, alarm_unset=OFF),
    "jtse": Habits(ack_with_data=True, refusal="{code}{error}"),
}


def station(
    family: str,
    rng: random.Random,
    habits: Habits | None = None,
    name: str = "",
    tools: Sequence[int] = (),
) -> Station:
    own = habits or Habits(**vars(OWN_HABITS[family]))
    if family == "jtse":
        return HotAir(name or NAMES[family], rng, own)
    made = Soldering(family, name or NAMES[family], rng, own, tools or TOOLS[family])
    if family == "ucr":
        made.maximum = 450
    return made


def cable(
    family: str,
    seed: int,
    p: float = 0.0,
    habits: Habits | None = None,
    name: str = "",
    tools: Sequence[int] = (),
) -> Cable:
    rng = random.Random(seed)
    return Cable(station(family, rng, habits, name, tools), rng, p)


# -- on real ports ---------------------------------------------------------------------------------


class Served:
    """Cables on pseudo-terminals below `folder`, or on TCP ports of this machine, served by a
    thread until it is left.
    """

    def __init__(self, cables: dict[str, Cable], folder: Path, *, tcp: bool = False) -> None:
        self.urls: dict[str, str] = {}
        self._selector = selectors.DefaultSelector()
        self._due: list[tuple[float, int, int, bytes]] = []
        self._sockets: dict[int, socket.socket] = {}
        self._terminals: list[tuple[str, int, int]] = []
        self._ended_slaves: list[int] = []
        self._listening: dict[str, socket.socket] = {}
        self._order = 0
        self._ended = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        for name, one in cables.items():
            (self._tcp if tcp else self.plug)(name, one, folder)

    def plug(self, name: str, one: Cable, folder: Path) -> None:
        """Serve a cable on a new pseudo-terminal, under a name that an earlier one may have had."""
        master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        link = folder / name
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(slave))
        self.urls[name] = str(link)
        self._selector.register(master, selectors.EVENT_READ, one)
        self._terminals.append((name, master, slave))

    def unplug(self, name: str) -> None:
        """End its pseudo-terminals. Their numbers stay taken until all ends: another process that
        got one would be told that its terminal is in use.
        """
        for terminal in [each for each in self._terminals if each[0] == name]:
            self._terminals.remove(terminal)
            self._selector.unregister(terminal[1])
            os.close(terminal[1])
            self._ended_slaves.append(terminal[2])

    def _tcp(self, name: str, one: Cable, _folder: Path) -> None:
        self._listen(name, one, 0)
        self.urls[name] = f"socket://127.0.0.1:{self._listening[name].getsockname()[1]}"

    def _listen(self, name: str, one: Cable, port: int) -> None:
        listening = socket.create_server(("127.0.0.1", port))
        listening.setblocking(False)
        self._selector.register(listening, selectors.EVENT_READ, (listening, one))
        self._listening[name] = listening

    def refuse(self, name: str, seconds: float) -> None:
        """Refuse connections to a TCP port, and listen there again after some seconds."""
        listening = self._listening.pop(name)
        one = self._selector.unregister(listening).data[1]
        port = listening.getsockname()[1]
        listening.close()
        threading.Timer(seconds, self._listen, (name, one, port)).start()

    def __enter__(self) -> Served:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self._thread.join()
        for name in [each[0] for each in self._terminals]:
            self.unplug(name)
        for slave in self._ended_slaves:
            os.close(slave)
        for one in (*self._listening.values(), *self._sockets.values()):
            one.close()

    def _serve(self) -> None:
        while not self._ended:
            wait = min(max(self._due[0][0] - time.monotonic(), 0.0), 0.1) if self._due else 0.1
            for key, _ in self._selector.select(wait):
                if isinstance(key.data, tuple):
                    self._accept(*key.data)
                else:
                    self._hear(key.fd, key.data)
            while self._due and self._due[0][0] <= time.monotonic():
                _, _, port, data = heapq.heappop(self._due)
                # the host is gone: its bytes fall on the floor, as on a wire
                with contextlib.suppress(OSError):
                    os.write(port, data)

    def _accept(self, listening: socket.socket, one: Cable) -> None:
        come, _ = listening.accept()
        come.setblocking(False)
        come.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sockets[come.fileno()] = come
        self._selector.register(come, selectors.EVENT_READ, one)

    def _hear(self, port: int, one: Cable) -> None:
        try:
            data = os.read(port, 4096)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            if port in self._sockets:
                self._selector.unregister(port)
                self._sockets.pop(port).close()
            return
        for at, answer in one.receive(data, time.monotonic()):
            self._order += 1
            heapq.heappush(self._due, (at, self._order, port, answer))


def line_file(
    urls: dict[str, str],
    families: dict[str, str],
    name: str = "outside",
    more: dict[str, str] | None = None,
) -> str:
    """The text of a line file."""
    parts = [f'[line]\nname = "{name}"\n']
    for one, url in urls.items():
        parts.append(
            f'[[station]]\nname = "{one}"\nurl = "{url}"\nfamily ='
            f' "{families[one]}"\n{(more or {}).get(one, "")}\n'
        )
    return "\n".join(parts)
