"""What a run requires of one station."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from jbclog.config.recipe import Recipe
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.family import Family


@dataclass(frozen=True, slots=True)
class StationTask:
    """What a run requires of one station.

    `family` None: "auto". `ports` None: those that answer. `model`: the name that the line file
    accepts for the station, if any. `rate` is in Hz, or ``auto`` (a usual rate with a fifth of the
    link's time in reserve), ``fit`` (the recipe's, or the best that fits), or ``max`` (without
    pause); None for the recipe's. `t0` is the run's zero on the monotonic clock; `duration_s` is
    None for a run without a stated end. `sharers` says which other programs have the port open.
    """

    name: str
    url: str
    family: Family | None
    line: LineFormat
    address: int | None
    ports: tuple[int, ...] | None
    recipe: Recipe
    recipe_file: str
    families: Mapping[str, Family]
    t0: float
    duration_s: float | None = None
    rate: float | str | None = None
    rated_power_w: float | None = None
    allow_omega_write: bool = False
    may_be_missing: bool = False  # the run may start without this station
    model: str | None = None
    sharers: Callable[[], str] = lambda: ""
