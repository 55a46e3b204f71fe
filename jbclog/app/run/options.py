"""Options of a run, and what the user states about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jbclog.core.errors import Problem
from jbclog.core.goal import JOINTS, UNITS, Goal


@dataclass(frozen=True, slots=True)
class Metadata:
    """What the user states about a run."""

    operator: str | None = None
    order: str | None = None
    product: str | None = None
    units: tuple[str, ...] = ()
    tags: dict[str, str] = field(default_factory=dict)
    wire_lots: tuple[str, ...] = ()
    flux_lots: tuple[str, ...] = ()
    tips: tuple[str, ...] = ()
    reads_units: bool = False  # serials are read during the run

    def missing(self, required: Sequence[str]) -> list[str]:
        """Return the required names that were not given, as options of the command line."""
        given: dict[str, object] = {
            "operator": self.operator,
            "order": self.order,
            "product": self.product,
        }
        given |= {"unit": self.units or self.reads_units, "tip": self.tips}
        given |= {"wire_lot": self.wire_lots, "flux_lot": self.flux_lots}
        given_or_tags = {**given, **{f"tag.{name}": value for name, value in self.tags.items()}}
        return [_option(name) for name in required if not given_or_tags.get(name)]


def _option(name: str) -> str:
    return (
        f"--tag {name.removeprefix('tag.')}=…"
        if name.startswith("tag.")
        else f"--{name.replace('_', '-')} …"
    )


@dataclass(frozen=True, slots=True)
class RunOptions:
    """Options of a run.

    - `rate`: Hz, ``auto``, ``fit``, ``max``, or None for the recipe's
    - `metadata`: None in a dry run, in which nobody was asked yet
    - `wire`: record a serial capture
    - `allow_missing`: leave out stations that do not start
    - `guard`: a guard makes the tools safe if the recorder dies
    - `mistakes`: of the command line; the plan reports them with those of the files

    The run ends at the first of these: finished units, joints of all stations, `duration_s`;
    without any of them when the user ends it.
    """

    line: Path
    recipe: Path | None = None
    stations: tuple[str, ...] = ()
    duration_s: float | None = None
    rate: float | str | None = None
    metadata: Metadata | None = field(default_factory=Metadata)
    wire: bool = False
    guard: bool = True
    allow_omega_write: bool = False
    allow_missing: bool = False
    until_units: int | None = None
    until_joints: int | None = None
    mistakes: tuple[Problem, ...] = ()

    def goals(self) -> list[Goal]:
        """Return the numbers at which the run ends."""
        return [
            Goal(what, count)
            for what, count in ((UNITS, self.until_units), (JOINTS, self.until_joints))
            if count is not None
        ]

    @property
    def states_an_end(self) -> bool:
        """Whether the run has an end of its own; otherwise Ctrl-C is its regular end."""
        return self.duration_s is not None or bool(self.goals())
