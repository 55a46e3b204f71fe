"""What the copies of a run's recipes say of joints: their `[joints]` tables, as they were checked when the run began."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path

from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.rows import StationFacts
from jbclog.record.recipe_copies import recipe_copy


def joints_asked(folder: Path, facts: StationFacts) -> Mapping[str, object]:
    """The keys of a station's `[joints]`; none where its recipe has none or cannot be read."""
    if facts.recipe is None:
        return {}
    try:
        data = read_foreign(recipe_copy(folder, facts.recipe), Kind.SETTINGS)
        table = tomllib.loads(data.decode()).get("joints")
    except (OSError, ValueError):
        return {}
    return table if isinstance(table, dict) else {}
