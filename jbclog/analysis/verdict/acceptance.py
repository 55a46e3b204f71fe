"""The limits of a verdict: a recipe's `[acceptance]`, as a protocol, so that no recipe model is
needed here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, Protocol

BARE: Final = "none"
SURE: Final = 0.95
Confidence = float | Literal["none"]
"""`SURE`, or `BARE`: figures are judged without a bound."""


class Acceptance(Protocol):
    """The limits of one station. None: the recipe states no such limit, and it is not judged."""

    @property
    def coverage_percent(self) -> float | None:
        """Minimum coverage: readings of the tip temperature obtained / readings due."""

    @property
    def longest_gap_s(self) -> float | None:
        """Longest time without a temperature."""

    @property
    def idle_error_c(self) -> float | None:
        """Maximum mean difference of the idle tip from its setpoint, in either direction."""

    @property
    def idle_sd_c(self) -> float | None:
        """Maximum standard deviation of the idle tip around its mean."""

    @property
    def confidence(self) -> Confidence:
        """Confidence of the bound that must keep a limit, or `BARE`."""

    @property
    def alarms_max(self) -> int | None:
        """Maximum number of counted alarms."""

    @property
    def verification_days(self) -> float | None:
        """Maximum age of the tip verification when the run began."""

    @property
    def recovery_p95_s(self) -> float | None:
        """Maximum recovery time of 95 joints of 100."""

    @property
    def recovered_before_next_percent(self) -> float | None:
        """Minimum share of the joints after which the tip is back before the next one."""

    @property
    def joints_against_counter_percent(self) -> float | None:
        """Maximum difference between joints found and dispensing cycles counted, in either
        direction.
        """

    @property
    def reached_within_c(self) -> float | None:
        """How close to its setpoint a tool has to come. None: the default of `reached.py`."""

    @property
    def at_work_percent(self) -> float | None:
        """Minimum share of the time after that at work. None: the default of `reached.py`."""


@dataclass(frozen=True, slots=True)
class Limits:
    """An `Acceptance` of plain values, for callers without a recipe."""

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


REACHED_LIMITS: Final = ("reached_within_c", "at_work_percent")
JOINT_LIMITS: Final = (
    "recovery_p95_s",
    "recovered_before_next_percent",
    "joints_against_counter_percent",
)
LIMIT_NAMES: Final = (
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
"""The limits about estimated figures, which have a bound."""


def is_bare(acceptance: Acceptance) -> bool:
    """Whether estimated figures are judged without their bounds."""
    return acceptance.confidence == BARE


def asks_for_anything(acceptance: Acceptance | None) -> bool:
    """Whether a recipe states any limit."""
    return acceptance is not None and any(
        getattr(acceptance, name) is not None for name in LIMIT_NAMES
    )


def asks_for_joints(acceptance: Acceptance | None) -> bool:
    """Whether a recipe limits joints, which then have to be searched before it can be judged; that
    takes time.
    """
    return acceptance is not None and any(
        getattr(acceptance, name) is not None for name in JOINT_LIMITS
    )
