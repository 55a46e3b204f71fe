"""The limits in a recipe's `[acceptance]`: which are set, and which need what."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:  # importing pydantic for a verdict would be slow
    from jbclog.config.recipe_sections import Acceptance


BARE: Final = "none"  # as `confidence`: estimated figures are judged without a bound
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
"""Limits on estimated figures, which have a bound."""


def is_bare(acceptance: Acceptance) -> bool:
    """Whether estimated figures are judged without their bounds."""
    return acceptance.confidence == BARE


def asks_for_anything(acceptance: Acceptance | None) -> bool:
    """Whether a recipe states any limit."""
    return acceptance is not None and any(
        getattr(acceptance, name) is not None for name in LIMIT_NAMES
    )


def asks_for_joints(acceptance: Acceptance | None) -> bool:
    """Whether a recipe limits joints; finding them takes time."""
    return acceptance is not None and any(
        getattr(acceptance, name) is not None for name in JOINT_LIMITS
    )
