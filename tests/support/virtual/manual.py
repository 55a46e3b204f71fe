"""`jbclog read` and `jbclog write` in this process, against virtual stations in memory, on a clock
that jumps.

``Bench(folder, line_text).do("read", "dde-1", "power")`` gives exit code, stdout and stderr;
`heard` is what a station was asked.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from typer.testing import CliRunner

from support.clients.talk import framed
from support.product import (
    LineFormat,
    ManualTarget,
    PortAccess,
    StationSpec,
    VirtualClock,
    command_line,
    parse_line,
    target_in,
    virtual_station,
)
from support.virtual.answers import let_say

LINE = '[line]\nname = "hand"\n'


def station_text(name: str, family: str, keys: str = "", sim: str = "") -> str:
    """One table of a line file."""
    return (
        f'[[station]]\nname = "{name}"\nurl = "{name}"\nfamily ='
        f' "{family}"\n{keys}\n[station.sim]\n{sim}\n'
    )


class Wire:
    """The cable to one virtual station. `watch` sees each question, and may pull the cable by
    raising.

    What begins with `only_acknowledged` is acknowledged, and never comes to the station.
    """

    def __init__(self, spec: StationSpec, clock: VirtualClock) -> None:
        self.station = virtual_station(spec, now=clock.monotonic())
        self.heard: list[bytes] = []
        self.opened = 0
        self.watch: Callable[[str], object] = lambda text: None
        self.only_acknowledged = "-"

    @property
    def texts(self) -> list[str]:
        """What it was asked, without frame and addresses: ``RTT1``."""
        return [text_of(data) for data in self.heard]

    @property
    def writes(self) -> list[str]:
        return [text for text in self.texts if text[0] in "WDH"]

    def take(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        """Put a question on the wire; what comes back, and when."""
        self.heard.append(data)
        text = text_of(data)
        self.watch(text)
        if text.startswith(self.only_acknowledged):
            return [(now, framed("A" + text[1:4]))]
        return [(reply.at, reply.data) for reply in self.station.receive(data, now)]


def text_of(frame: bytes) -> str:
    """A question without frame and addresses: ``RTT1``."""
    # one byte behind ETX, or two of OMEGA's
    body = frame[1 : -2 if frame[-2] == 0x03 else -3].decode()
    return body[4:] if body[:4].isdigit() else body


class MemoryPort:
    """One end of a `Wire`: what is waited for is there when the clock has jumped to it."""

    def __init__(self, url: str, wire: Wire, clock: VirtualClock) -> None:
        self.url = url
        self._wire = wire
        self._clock = clock
        self._coming: list[tuple[float, bytes]] = []

    def fileno(self) -> int | None:
        return None

    def write(self, data: bytes) -> None:
        coming = [*self._coming, *self._wire.take(data, self._clock.monotonic())]
        self._coming = sorted(coming, key=lambda one: one[0])

    def read_now(self) -> bytes:
        return self.read(0.0)

    def read(self, timeout_s: float) -> bytes:
        end = self._clock.monotonic() + timeout_s
        if not self._coming or self._coming[0][0] > end:
            self._clock.advance_to(end)
            return b""
        at, data = self._coming.pop(0)
        self._clock.advance_to(at)
        return data

    def close(self) -> None:
        self._coming = []


@dataclass
class Ended:
    """What a call came to."""

    code: int
    out: str
    err: str


class Bench:
    """A line file in `folder` and its virtual stations, which `read` and `write` find there through
    `access`.
    """

    def __init__(self, folder: Path, *stations: str) -> None:
        self.line = folder / "line.toml"
        self.line.write_text(LINE + "".join(stations), encoding="utf-8")
        self.clock = VirtualClock()
        specs = parse_line(self.line.read_text(encoding="utf-8"), self.line).stations
        self.wires = {spec.name: Wire(spec, self.clock) for spec in specs}
        self._by_url = {spec.url: self.wires[spec.name] for spec in specs}
        self.access = PortAccess(
            self._open,
            lambda seconds: self.clock.advance_to(self.clock.monotonic() + seconds),
            self.clock,
        )

    def _open(self, url: str, line: LineFormat) -> MemoryPort:
        wire = self._by_url[url]
        wire.opened += 1
        return MemoryPort(url, wire, self.clock)

    def target(self, name: str) -> ManualTarget:
        return target_in(self.line, name)

    def do(self, *words: str) -> Ended:
        """Call the program with this line file."""
        return self.call(*words, "--line", str(self.line))

    def call(self, *words: str) -> Ended:
        """Call the program with these words, or with those of a call as it is told: ``jbclog write
        ...``.
        """
        if len(words) == 1:
            words = tuple(shlex.split(words[0])[1:])
        ended = CliRunner().invoke(command_line, list(words), obj=self.access)
        if ended.exception is not None and not isinstance(ended.exception, SystemExit):
            raise ended.exception
        return Ended(ended.exit_code, ended.stdout, ended.stderr)

    def wait(self, seconds: float) -> None:
        """Let the stations go on."""
        self.clock.advance_to(self.clock.monotonic() + seconds)


def says(bench: Bench, station: str, code: str, *data: str, last: bool = False) -> None:
    """Let a JBC station answer a question with these data fields first; see `said.let_say`."""
    let_say(bench.wires[station].station.device, code, *data, last=last)  # type: ignore[union-attr]  # a JBC station


Make = Callable[..., Bench]
"""Makes the bench with these stations that `read` and `write` find from then on."""
