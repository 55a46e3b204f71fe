"""Figures of a station's use: how much it worked, how long it was hot for nothing, how it sleeps."""

from __future__ import annotations

from jbclog.audit.fleet import Meter, UseFigure


def use_of(meters: tuple[Meter, ...]) -> tuple[UseFigure, ...]:
    """The figures that these meters give."""
    return ()
