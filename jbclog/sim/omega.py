"""A virtual OMEGA: its plant, and its device.

It answers after a random 0 to 250 ms, or after `turnaround_ms` if the line file sets it. A wrong
sum, an unknown command, an unknown number and a value out of range get no answer (003, 11.2;
docs/reference/protocol.md). H is answered when the joint is completed, however late.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Final, NamedTuple

from jbclog.config.line import StationSpec
from jbclog.config.sim_spec import FaultSpec, SimSpec
from jbclog.core.errors import UsageError
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.commands.omega import (
    AT_TEMPERATURE,
    CLEANING,
    CONTROL,
    INFORMATION,
    MODES,
    Cleaning,
    ConditionNumber,
    ConditionRecord,
    SetTemperature,
    StoredCondition,
    StoredRecord,
    is_condition,
)
from jbclog.sim.device import AcceptedWrite, Device, RefusedRequest
from jbclog.sim.faults import OF_OMEGA, ON_ANSWERS, KnownNames
from jbclog.sim.plant import TableRequest
from jbclog.sim.tip import JointSchedule

# Where no document describes a controller: it prepares for `WARM_UP_S` after switching on; its
# temperature leaves the range in the later part of each joint and is back at its end; a condition
# takes as long as its times and its feeds, and 0 mm/s moves nothing; its solder wire moves at most
# at `MOST_MM_S`. That proves nothing about a real one.

WARM_UP_S = 5.0
DIPS_AFTER = 0.4  # share of a joint after which its temperature leaves the range
MOST_MM_S = 60.0
MODE_OF_HUNDRED = {1: 0, 2: 1, 3: 4}  # special point, special slide, pre-solder
SLIDES = (1, 3)
FEEDS = (("feed1_mm", "feed1_mm_s"), ("feed2_mm", "feed2_mm_s"), ("feed3_mm", "feed3_mm_s"))
BACK = (
    ("reverse1_mm", "reverse1_mm_s"),
    ("reverse2_mm", "reverse2_mm_s"),
    ("reverse3_mm", "reverse3_mm_s"),
)


def usual(number: int) -> StoredRecord:
    """Return the initial record of a number."""
    if number == CLEANING:
        return Cleaning(0.5)
    mode = MODE_OF_HUNDRED[number // 100]
    return ConditionRecord(
        number, mode, 0.3, 2.0, 10.0, 0.5, 10.0, 0.8, 3.0, 8.0, 0.5, 10.0, 1.0, 0.0, 0.0, 1.0, 20.0
    )


class Completion(NamedTuple):
    """The message that ends a joint, and when it is sent."""

    letter: str
    at: float


class OmegaPlant:
    """One controller and its machine. Times are monotonic seconds. `judges_optimum`: F says whether
    the temperature is optimal, which it is not from the beginning of a joint on.
    """

    def __init__(
        self,
        began: float,
        joints: JointSchedule,
        stored: Mapping[int, StoredRecord],
        *,
        judges_optimum: bool = False,
    ) -> None:
        self.stored = dict(stored)
        self._dips_after = 0.0 if judges_optimum else DIPS_AFTER
        self.faults: set[str] = set()
        self._joints = joints
        self._joint = joints.after(began)
        self._ready_at = began + WARM_UP_S
        self._run_from = self._run_to = began  # the joint that H began
        self.completion = Completion("h", began)

    @property
    def ports(self) -> Collection[int]:
        return (1,)

    def advance_to(self, moment: float) -> None:
        while self._joint.end <= moment:
            self._joint = self._joints.after(self._joint.start)

    def value_of(self, asked: TableRequest, now: float) -> Value:
        match asked.command.name:
            case "information":
                return self.information()
            case "temperature_control":
                return self.control(now)
            case "set_temperature_state":
                return self.at_temperature(now)
            case "mode":
                return self.mode()
        return self.condition(asked.condition)

    def allowed(self, command: Command, value: Value) -> bool:
        """Return True if every field of a record is in its range."""
        if not isinstance(value, StoredRecord):
            return True
        return all(float(text) <= MOST_MM_S for _, unit, text in value.values() if unit == "mm/s")

    def apply(self, asked: TableRequest, value: Value, now: float) -> None:
        if isinstance(value, StoredRecord):
            self.store(value)
        elif isinstance(value, int):
            self._run(value, now)

    def restart(self, now: float) -> None:
        """Switch off and on again."""
        self._ready_at = now + WARM_UP_S
        self._run_to = now

    def keep(self) -> None:
        """Do nothing: no condition is volatile."""

    def strike(self, fault: FaultSpec, port: int, *, begins: bool) -> None:
        if begins:
            self.faults.add(fault.kind)
        else:
            self.faults.discard(fault.kind)

    def information(self) -> str:
        return INFORMATION.names[("solder_shortage" in self.faults) + 2 * ("clog" in self.faults)]

    def control(self, now: float) -> str:
        return CONTROL.names[now < self._ready_at or "not_ready" in self.faults]

    def at_temperature(self, now: float) -> str:
        self.advance_to(now)
        dips = any(
            begin + self._dips_after * (end - begin) <= now < end for begin, end in self._at_work()
        )
        return AT_TEMPERATURE.names[dips or now < self._ready_at or "out_of_range" in self.faults]

    def mode(self) -> str:
        return MODES[self.condition(301).mode]

    def condition(self, number: int) -> StoredRecord:
        return self.stored.get(number) or usual(number)

    def _at_work(self) -> list[tuple[float, float]]:
        return [(self._joint.start, self._joint.end), (self._run_from, self._run_to)]

    def store(self, value: StoredRecord) -> None:
        self.stored[value.condition] = value

    def _run(self, number: int, now: float) -> None:
        """Make the joint of this condition."""
        condition = self.condition(number)
        self._run_from = now
        self._run_to = now + seconds_of(condition)
        if condition.mode in SLIDES:
            self.completion = Completion("i", now + seconds_of(condition, first_stage=True))
        else:
            self.completion = Completion("h", self._run_to)


def seconds_of(condition: StoredRecord, *, first_stage: bool = False) -> float:
    """Return the duration of its joint in seconds; of a slide only the first stage."""
    if isinstance(condition, Cleaning):
        return condition.air_blow_s
    if not isinstance(condition, ConditionRecord):
        return 0.0
    stages = 1 if first_stage else len(FEEDS)
    times = (condition.rise_s, condition.preheat_s, 0.0 if first_stage else condition.heating_s)
    moves = [
        (float(getattr(condition, way)), float(getattr(condition, speed)))
        for way, speed in (*FEEDS[:stages], *BACK[:stages])
    ]
    return sum(times) + sum(way / speed for way, speed in moves if speed)


SLOWEST_S = 0.25  # 003 11.1
IN_DEGREES: Final = "temperature_in_degrees"
IS_OPTIMAL: Final = "in_range_is_optimal"
OMEGA_QUIRKS: Final = {IN_DEGREES: 51, IS_OPTIMAL: 55}
"""Quirks, with their rows of docs/reference/contradictions.md."""

KINDS: Final = OF_OMEGA | {"restart", "dropout"} | ON_ANSWERS
COMMANDS = FAMILIES["omega"].commands
BY_LETTER = {command.letters: command for command in COMMANDS.values()}
RECORD, NUMBER = StoredCondition(), ConditionNumber()
SET_C = 350  # temperature of condition 399


class OmegaAnswer(NamedTuple):
    """The text of an answer, begun at `at`. An unsolicited one waits for no other."""

    text: str
    at: float
    is_unsolicited: bool = False


class OmegaDevice(Device):
    """An OMEGA's electronics: takes and returns texts, without addresses and sums."""

    def __init__(self, plant: OmegaPlant) -> None:
        super().__init__(plant)
        self.plant = plant

    def asked(self, text: str) -> TableRequest | None:
        """Look up a request; None if there is no such command."""
        command = BY_LETTER.get(text[0])
        return TableRequest(command, text, 1) if command else None

    def answer(self, asked: TableRequest | None, text: str, now: float) -> OmegaAnswer | None:
        """Answer a request with a correct sum; None is a refusal, which is silent."""
        if asked is None:
            return None
        data = text[1:]
        match asked.command.name:
            case "store_condition":
                return self._store(asked, data, now)
            case "run_condition":
                return self._run(asked, data, now)
            case "condition":
                number = _number(data)
                if number is None:
                    return None
                asked = replace(asked, condition=number)
            case _ if data:
                return None
        value = self.plant.value_of(asked, now)
        self.log.reads += 1
        return OmegaAnswer(text[0].lower() + asked.command.quantity.encode(value), now)

    def refuse(self, text: str, now: float) -> None:
        """Ignore a request, as a controller does with one that it does not understand."""
        self.log.refused.append(RefusedRequest(now, text, 0))

    def _store(self, asked: TableRequest, data: str, now: float) -> OmegaAnswer | None:
        try:
            record = RECORD.decode(data)
        except ValueError:
            return None
        if not self.plant.allowed(asked.command, record):
            return None
        self._accept(asked, record, now)
        return OmegaAnswer("d", now)

    def _run(self, asked: TableRequest, data: str, now: float) -> OmegaAnswer | None:
        number = _number(data)
        if number is None or not is_condition(number):
            return None
        self._accept(asked, number, now)
        letter, done = self.plant.completion
        return OmegaAnswer(letter, done, is_unsolicited=True)

    def _accept(self, asked: TableRequest, value: Value, now: float) -> None:
        self.plant.apply(asked, value, now)
        self.log.writes.append(AcceptedWrite(now, asked.command.name, 0, 0, value))


def _number(data: str) -> int | None:
    """Return the number of an existing condition; None for others."""
    try:
        return 0 if data == "0000" else NUMBER.decode(data)
    except ValueError:
        return None


def build_omega(spec: StationSpec, now: float, seed: int) -> OmegaDevice:
    """Build a controller that is switched on at `now`."""
    sim = spec.sim or SimSpec()
    known = KnownNames((), OMEGA_QUIRKS, KINDS, COMMANDS, (1,))
    known.reject_others(spec.name, sim, "an omega")
    joints = JointSchedule(sim.joints_per_minute, sim.joint_seconds, seed, now)
    stored = _stored(spec.name, sim)
    return OmegaDevice(OmegaPlant(now, joints, stored, judges_optimum=IS_OPTIMAL in sim.quirks))


def _stored(station: str, sim: SimSpec) -> dict[int, StoredRecord]:
    """Return the initial conditions of the line file, and one that sets a temperature, in tenths or
    in whole degrees.
    """
    set_temperature = SetTemperature(399, SET_C if IN_DEGREES in sim.quirks else 10 * SET_C, 0)
    found: dict[int, StoredRecord] = {set_temperature.condition: set_temperature}
    for name, values in sim.settings.items():
        try:
            value = RECORD.decode(str(values).replace(" ", ""))
        except ValueError as error:
            raise UsageError(f"{station}: [station.sim] settings: {name}: {error}") from error
        if name != f"condition_{value.condition}":
            raise UsageError(
                f"{station}: [station.sim] settings: {name} is nothing that an omega can begin"
                f" with; {value}"
            )
        found[value.condition] = value
    return found
