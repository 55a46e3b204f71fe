"""Apply faults by name to answers, to the cable and to the physics. Data-driven, no I/O.

Times count from `start`; nothing happens before. `FaultSpec` describes each kind.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import inf
from random import Random
from typing import Final, NamedTuple

from jbclog.config.sim_spec import FaultSpec, SimSpec
from jbclog.core.errors import UsageError
from jbclog.sim.device import Device
from jbclog.sim.plant import TableRequest

ON_ANSWERS: Final = frozenset({"silence", "noise", "flip", "late", "nak"})
OF_OMEGA: Final = frozenset({"solder_shortage", "clog", "not_ready", "out_of_range"})
ON_PHYSICS: Final = frozenset({"restart", "stuck", "overheat", "tool"}) | OF_OMEGA


class FaultChange(NamedTuple):
    """A fault of the physics that begins or ends at `at`."""

    at: float
    fault: FaultSpec
    begins: bool


class FaultSchedule:
    """The schedule of one station's faults."""

    def __init__(self, faults: Sequence[FaultSpec], seed: int) -> None:
        self._faults = faults
        self._random = Random(seed)
        self._struck = dict.fromkeys(range(len(faults)), 0)
        self._on_answers = [
            (number, fault) for number, fault in enumerate(faults) if fault.kind in ON_ANSWERS
        ]
        self._changes: list[FaultChange] = []
        self._outages: list[tuple[float, float]] = []
        self.zero: float | None = None

    def start(self, now: float) -> None:
        """Start the schedule."""
        self.zero = now
        for fault in self._faults:
            begin, end = self._window(fault)
            if fault.kind in ON_PHYSICS:
                self._changes += [FaultChange(begin, fault, True), FaultChange(end, fault, False)]
            elif fault.kind == "dropout":
                self._outages.append((begin, end))
        self._changes.sort(key=lambda change: change.at)

    def changes(self, now: float) -> list[FaultChange]:
        """Return the changes of the physics that are due, in order, each once."""
        if not self._changes:
            return []
        due = bisect_right(self._changes, now, key=lambda change: change.at)
        taken, self._changes = self._changes[:due], self._changes[due:]
        return taken

    def unplugged(self, now: float) -> bool:
        return bool(self._outages) and any(begin <= now < end for begin, end in self._outages)

    def next_plugging(self, now: float) -> float | None:
        """Return when the cable is next unplugged or plugged; None: never, or no request yet."""
        return min(
            (moment for outage in self._outages for moment in outage if moment > now), default=None
        )

    def strikes(self, asked: TableRequest | None, header: str, now: float) -> list[FaultSpec]:
        """Return the faults that affect the answer to this request."""
        if not self._on_answers or self.zero is None:
            return []
        return [
            fault
            for number, fault in self._on_answers
            if self._hits(number, fault, asked, header, now)
        ]

    def spoil(self, answer: bytes, faults: Sequence[FaultSpec]) -> tuple[bytes, float]:
        """Apply faults to `answer`; return the result (b"": silence), and the delay in s."""
        late_s = 0.0
        for fault in faults:
            match fault.kind:
                case "silence":
                    answer = b""
                case "flip":
                    answer = self._flipped(answer, fault.bits)
                case "noise":
                    answer = self._random.randbytes(fault.bytes_count) + answer
                case "late":
                    late_s += fault.by_s
        return answer, late_s

    def _flipped(self, answer: bytes, bits: int) -> bytes:
        """Return `answer` with `bits` different bits inverted."""
        whole = int.from_bytes(answer, "big")
        for place in self._random.sample(range(8 * len(answer)), min(bits, 8 * len(answer))):
            whole ^= 1 << place
        return whole.to_bytes(len(answer), "big")

    def _window(self, fault: FaultSpec) -> tuple[float, float]:
        begin = (self.zero or 0.0) + fault.at_s
        return begin, begin + (inf if fault.for_s is None else fault.for_s)

    def _hits(
        self, number: int, fault: FaultSpec, asked: TableRequest | None, header: str, now: float
    ) -> bool:
        begin, end = self._window(fault)
        if not begin <= now < end or not _meant(fault, asked, header):
            return False
        self._struck[number] += 1
        return self._struck[number] % fault.every == 0


def _meant(fault: FaultSpec, asked: TableRequest | None, header: str) -> bool:
    if fault.only is not None and header != fault.only[0].upper():
        return False
    if fault.command is None and fault.port is None:
        return True
    return (
        asked is not None
        and fault.command in (None, asked.command.name)
        and fault.port in (None, asked.port)
    )


@dataclass(frozen=True, slots=True)
class KnownNames:
    """What a station has that `[station.sim]` can name."""

    counters: Collection[str]
    quirks: Collection[str]
    faults: Collection[str]
    commands: Collection[str]
    ports: Collection[int]

    def reject_others(self, station: str, sim: SimSpec, owner: str) -> None:
        """Raise `UsageError` for a name that `owner` does not have, because it would silently have
        no effect.
        """
        wrong = [f"counters: {name}" for name in sim.counters if name not in self.counters]
        wrong += [f"tools: {port}" for port in sim.tools if port not in self.ports]
        wrong += [f"quirks: {name}" for name in sim.quirks if name not in self.quirks]
        for fault in sim.fault:
            if fault.kind not in self.faults:
                wrong.append(f"fault {fault.kind}")
            if fault.command and fault.command not in self.commands:
                wrong.append(f"fault {fault.kind}: {fault.command}")
            if fault.port and fault.port not in self.ports:
                wrong.append(f"fault {fault.kind}: port {fault.port}")
        if wrong:
            raise UsageError(f"{station}: [station.sim] {', '.join(wrong)}: {owner} has none")


def apply_fault(change: FaultChange, device: Device) -> None:
    """Begin or end a fault of the physics on this device."""
    fault = change.fault
    device.face.advance_to(change.at)
    if fault.kind == "restart":
        if change.begins and fault.for_s is not None:
            device.restart(change.at, fault.for_s)
        return
    for number in device.face.ports:
        if fault.port in (None, number):
            device.face.strike(fault, number, begins=change.begins)
