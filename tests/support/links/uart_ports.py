"""Ports with a line format at both ends, in memory, on a clock that jumps.

``Cable(far_end, line)`` is a far end that speaks at `line`. A client at another rate or parity is
not heard, and hears junk at another rate (`jbclog.sim.links`); ``access_to({url: cable})`` is what
`jbclog.app.discovery` opens ports with.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from support.product import (
    LineFormat,
    LinkError,
    PortAccess,
    PortMissing,
    VirtualClock,
    heard,
    parse_line,
    virtual_station,
)
from support.virtual.answers import let_say

Coming = Sequence[tuple[float, bytes]]


class FarEnd(Protocol):
    def receive(self, data: bytes, now: float) -> Coming: ...


class Cable:
    """One far end and its line format; None: a piece of wire, which has none.

    `speaks` is what it says unasked: period in seconds and bytes.
    """

    def __init__(
        self, far: FarEnd, line: LineFormat | None, speaks: tuple[float, bytes] | None = None
    ) -> None:
        self.far = far
        self.line = line
        self.speaks = speaks
        self.asked: list[tuple[LineFormat, bytes]] = []  # what was sent, at which format
        self.coming: list[tuple[float, bytes]] = []
        self.opened = 0
        self.breaks_at: float | None = None


class UartPort:
    """The near end, opened at `line`."""

    def __init__(self, url: str, cable: Cable, line: LineFormat, clock: VirtualClock) -> None:
        self.url = url
        self._cable = cable
        self._line = line
        self._clock = clock
        self._opened = clock.monotonic()
        cable.coming = []
        cable.opened += 1

    def fileno(self) -> int | None:
        return None

    def write(self, data: bytes) -> None:
        self._check()
        now = self._clock.monotonic()
        self._cable.asked.append((self._line, data))
        got = heard(data, self._line, self._cable.line or self._line)
        self._cable.coming += self._cable.far.receive(got, now) if got else []

    def read_now(self) -> bytes:
        self._check()
        now = self._clock.monotonic()
        due = b"".join(
            data for at, data in sorted(self._all(now), key=lambda one: one[0]) if at <= now
        )
        self._cable.coming = [one for one in self._cable.coming if one[0] > now]
        self._opened = now
        return heard(due, self._cable.line or self._line, self._line, keeps_errors=True)

    def read(self, timeout_s: float) -> bytes:
        until = self._clock.monotonic() + timeout_s
        while True:
            self._clock.advance_to(min([until, *(at for at, _ in self._all(until))]))
            data = self.read_now()
            if data or self._clock.monotonic() >= until:
                return data

    def close(self) -> None:
        return

    def _all(self, until: float) -> Coming:
        """What is on its way, and what is said unasked until then."""
        if self._cable.speaks is None:
            return self._cable.coming
        period, data = self._cable.speaks
        first = int(self._opened / period) + 1
        return [
            *self._cable.coming,
            *((turn * period, data) for turn in range(first, int(until / period) + 1)),
        ]

    def _check(self) -> None:
        if self._cable.breaks_at is not None and self._clock.monotonic() >= self._cable.breaks_at:
            raise LinkError(f"{self.url}: cannot be read; is it unplugged?")


def access_to(cables: dict[str, Cable], clock: VirtualClock | None = None) -> PortAccess:
    """Access to these cables."""
    clock = clock or VirtualClock()

    def open_port(url: str, line: LineFormat) -> UartPort:
        if url not in cables:
            raise PortMissing(f"{url}: no such port; check that it is plugged in")
        return UartPort(url, cables[url], line, clock)

    return PortAccess(
        open_port, lambda seconds: clock.advance_to(clock.monotonic() + seconds), clock
    )


def station_cable(
    family: str, keys: str = "", sim: str = "", clock: VirtualClock | None = None
) -> Cable:
    """The cable to a virtual station that a line file would describe so."""
    text = (
        '[line]\nname = "x"\n[[station]]\nname = "s"\nurl = "s"\nfamily ='
        f' "{family}"\n{keys}\n[station.sim]\n{sim}\n'
    )
    (spec,) = parse_line(text, Path("line.toml")).stations
    now = (clock or VirtualClock()).monotonic()
    return Cable(virtual_station(spec, now=now), spec.line_format)


def says(cable: Cable, code: str, *data: str, last: bool = False) -> None:
    """Let the virtual JBC station at a cable answer a question with these data fields first; see
    `said.let_say`.
    """
    let_say(cable.far.device, code, *data, last=last)  # type: ignore[attr-defined]  # the virtual station's own


class Silence:
    """Nobody is there."""

    def receive(self, data: bytes, now: float) -> Coming:
        return []


class Echo:
    """A loop-back; with somebody behind it, an adapter for RS-485 with echo."""

    def __init__(self, behind: FarEnd | None = None) -> None:
        self.behind = behind or Silence()

    def receive(self, data: bytes, now: float) -> Coming:
        return [(now + 0.001 * len(data), data), *self.behind.receive(data, now)]
