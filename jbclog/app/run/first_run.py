"""The first run of a line that `jbclog sim` serves: its recipe and duration."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.core.errors import UsageError

FIRST_DURATION: Final = "3m"
"""Long enough for the limits of the recipes in `profiles/recipes` on resting tips, which need some
rest before they are known.
"""


def fitting_recipe(line: Path, served: Path) -> Path | None:
    """Return the first recipe in the folders `recipes` beside LINE or its folder that a run of the
    line file `served` takes; None if there is none. Opens no port.
    """
    for folder in (line.parent / "recipes", line.parent.parent / "recipes"):
        for recipe in sorted(folder.glob("*.toml")):
            try:
                make_plan(RunOptions(served, recipe))
            except UsageError:
                continue
            return recipe
    return None
