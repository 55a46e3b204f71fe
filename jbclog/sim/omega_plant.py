"""What happens in a virtual OMEGA: warming up, joints, solder that runs out, and the conditions that it has stored.

Where no document says what a controller does, this one does so: it prepares for `WARM_UP_S` after it was switched on; its
temperature leaves the range in the later part of each joint and is back when the joint is over; a condition takes as long as
its times and its feeds, and 0 mm/s moves nothing; its wire goes no faster than `MOST_MM_S`. That proves nothing about a real one.
"""

from __future__ import annotations

from collections.abc import Mapping

from jbclog.protocol.commands.omega import AT_TEMPERATURE, CONTROL, INFORMATION
from jbclog.protocol.commands.omega_values import CLEANING, MODES, Cleaning, ConditionRecord, Stored
from jbclog.sim.tip import Joints

WARM_UP_S = 5.0
DIPS_AFTER = 0.4  # of a joint, its temperature leaves the range
MOST_MM_S = 60.0
MODE_OF_HUNDRED = {1: 0, 2: 1, 3: 4}  # special point, special slide, pre-solder
SLIDES = (1, 3)
FEEDS = (("feed1_mm", "feed1_mm_s"), ("feed2_mm", "feed2_mm_s"), ("feed3_mm", "feed3_mm_s"))
BACK = (("reverse1_mm", "reverse1_mm_s"), ("reverse2_mm", "reverse2_mm_s"), ("reverse3_mm", "reverse3_mm_s"))


def usual(number: int) -> Stored:
    """What is stored under a number that nobody has written yet."""
    if number == CLEANING:
        return Cleaning(0.5)
    mode = MODE_OF_HUNDRED[number // 100]
    return ConditionRecord(number, mode, 0.3, 2.0, 10.0, 0.5, 10.0, 0.8, 3.0, 8.0, 0.5, 10.0, 1.0, 0.0, 0.0, 1.0, 20.0)


class OmegaPlant:
    """One controller and what it drives. Moments are monotonic seconds."""

    def __init__(self, began: float, joints: Joints, stored: Mapping[int, Stored]) -> None:
        self.stored = dict(stored)
        self.faults: set[str] = set()
        self._joints = joints
        self._joint = joints.after(began)
        self._ready_at = began + WARM_UP_S
        self._run_from = self._run_to = began  # the joint that H began

    def restart(self, now: float) -> None:
        """It is switched on anew."""
        self._ready_at = now + WARM_UP_S
        self._run_to = now

    def advance_to(self, moment: float) -> None:
        while self._joint.end <= moment:
            self._joint = self._joints.after(self._joint.start)

    # -- what it tells ---------------------------------------------------------------------------------------------

    def information(self) -> str:
        return INFORMATION.names[("solder_shortage" in self.faults) + 2 * ("clog" in self.faults)]

    def control(self, now: float) -> str:
        return CONTROL.names[now < self._ready_at or "not_ready" in self.faults]

    def at_temperature(self, now: float) -> str:
        self.advance_to(now)
        dips = any(begin + DIPS_AFTER * (end - begin) <= now < end for begin, end in self._at_work())
        return AT_TEMPERATURE.names[dips or now < self._ready_at or "out_of_range" in self.faults]

    def mode(self) -> str:
        return MODES[self.condition(301).mode]

    def condition(self, number: int) -> Stored:
        return self.stored.get(number) or usual(number)

    def _at_work(self) -> list[tuple[float, float]]:
        return [(self._joint.start, self._joint.end), (self._run_from, self._run_to)]

    # -- what it is told -------------------------------------------------------------------------------------------

    def takes(self, value: Stored) -> bool:
        """Whether every field is in its range."""
        return all(float(text) <= MOST_MM_S for _, unit, text in value.values() if unit == "mm/s")

    def store(self, value: Stored) -> None:
        self.stored[value.condition] = value

    def run(self, number: int, now: float) -> tuple[str, float]:
        """Make the joint of this condition; what will be said of it, and when."""
        condition = self.condition(number)
        slides = condition.mode in SLIDES
        self._run_from = now
        self._run_to = now + seconds_of(condition)
        return ("i", now + seconds_of(condition, first_stage=True)) if slides else ("h", self._run_to)


def seconds_of(condition: Stored, *, first_stage: bool = False) -> float:
    """How long its joint takes; only its first stage, of a slide."""
    if isinstance(condition, Cleaning):
        return condition.air_blow_s
    if not isinstance(condition, ConditionRecord):
        return 0.0
    stages = 1 if first_stage else len(FEEDS)
    times = (condition.rise_s, condition.preheat_s, 0.0 if first_stage else condition.heating_s)
    moves = [(float(getattr(condition, way)), float(getattr(condition, speed))) for way, speed in (*FEEDS[:stages], *BACK[:stages])]
    return sum(times) + sum(way / speed for way, speed in moves if speed)
