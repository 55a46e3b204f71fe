"""What a verdict may rest on: a recipe's `[acceptance]`, whoever holds it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, Protocol

BARE: Final = "none"
SURE: Final = 0.95
Confidence = float | Literal["none"]
"""`SURE`, or that figures are judged without a bound."""


class Acceptance(Protocol):
    """The limits of one station. None: the recipe does not ask for it, and it is not judged."""

    @property
    def coverage_percent(self) -> float | None:
        """Least share of the due readings of the tip temperature that are there."""

    @property
    def longest_gap_s(self) -> float | None:
        """Longest time without a temperature."""

    @property
    def idle_error_c(self) -> float | None:
        """Greatest distance, either way, of the idle tip from its setting, on average."""

    @property
    def idle_sd_c(self) -> float | None:
        """Greatest standard deviation of the idle tip around its setting."""

    @property
    def confidence(self) -> Confidence:
        """The confidence that a figure's bound has to have for a limit to be kept, or that bare figures are judged."""

    @property
    def alarms_max(self) -> int | None:
        """How many counted alarms are allowed."""

    @property
    def verification_days(self) -> float | None:
        """Greatest age of the tip's verification against an external thermometer when the run began."""

    @property
    def recovery_p95_s(self) -> float | None:
        """Longest time in which the tip is to be back after 95 joints of 100."""

    @property
    def recovered_before_next_percent(self) -> float | None:
        """Least share of the joints after which the tip is back before the next one."""

    @property
    def joints_against_counter_percent(self) -> float | None:
        """Greatest difference, either way, of the joints found from the feeds that the feeder counted."""

    @property
    def reached_within_c(self) -> float | None:
        """How near to its setting a tool has to come. None: the usual distance (`reached`)."""

    @property
    def at_work_percent(self) -> float | None:
        """For how much of the time after that it has to be at work. None: the usual share."""


@dataclass(frozen=True, slots=True)
class Limits:
    """An `Acceptance` of plain values, for callers without a recipe model."""

    coverage_percent: float | None = None
    longest_gap_s: float | None = None
    idle_error_c: float | None = None
    idle_sd_c: float | None = None
    alarms_max: int | None = None
    verification_days: float | None = None
    recovery_p95_s: float | None = None
    recovered_before_next_percent: float | None = None
    joints_against_counter_percent: float | None = None
    reached_within_c: float | None = None
    at_work_percent: float | None = None
    confidence: Confidence = SURE


REACHED_LIMITS = ("reached_within_c", "at_work_percent")
JOINT_LIMITS = ("recovery_p95_s", "recovered_before_next_percent", "joints_against_counter_percent")
LIMIT_NAMES = (
    "coverage_percent",
    "longest_gap_s",
    "idle_error_c",
    "idle_sd_c",
    "alarms_max",
    "verification_days",
    *JOINT_LIMITS,
    *REACHED_LIMITS,
)


ESTIMATED_LIMITS: Final = ("idle_error_c", "idle_sd_c", "recovery_p95_s")
"""Those about figures that are estimates, and so have a bound."""


def is_bare(acceptance: Acceptance) -> bool:
    """Whether estimated figures are judged without their bounds."""
    return acceptance.confidence == BARE


def asks_for_anything(acceptance: Acceptance | None) -> bool:
    """Whether there is any limit at all to judge by."""
    return acceptance is not None and any(getattr(acceptance, name) is not None for name in LIMIT_NAMES)


def asks_for_joints(acceptance: Acceptance | None) -> bool:
    """Whether joints have to be looked for, which costs time, before it can be judged."""
    return acceptance is not None and any(getattr(acceptance, name) is not None for name in JOINT_LIMITS)
