"""A store of a plant with one run, for what other programs may do to it."""

from __future__ import annotations

from support.records.plant_store import filled, run, store

__all__ = ["filled", "run", "store"]
